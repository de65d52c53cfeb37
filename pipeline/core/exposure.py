"""The exposure: how often the conditions of a scenario space occur on the road.

It is the density f of thesis Def. 4.11.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.marginals import Marginal, marginal, uniform
from pipeline.core.names import nearest
from pipeline.core.rejection import feasible
from pipeline.core.space import Floats, Space

DRAWS = 200_000
"""Draws that show how much of a distribution the constraints leave."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """A distribution over a space: regimes such as dry, rain and fog.

    Inside a regime, all variables are independent. Points that break a constraint do not occur;
    the others keep their proportions. Points are computed from latent numbers in [0, 1),
    (n, 1 + d): the first chooses the regime, the others are quantiles of the variables. Uniform
    latent numbers give points of the exposure.

    Args:
        space: of the points.
        shares: (c,) of the regimes; they sum to 1.
        marginals: for each regime, a marginal of each variable.
    """

    space: Space
    shares: Floats
    marginals: tuple[tuple[Marginal, ...], ...]

    @staticmethod
    def from_dict(space: Space, plain: Mapping[str, Any]) -> Exposure:
        """The exposure of plain data, `{variables: {name: {kind, ...}}, regimes: {name: ...}}`.

        Each regime is `{share, variables}`. Variables that the data do not name are uniform; a
        regime's variables replace those of the same name.

        Raises:
            ValueError: an unknown variable, a wrong marginal, or wrong shares.
        """
        common = plain.get("variables", {})
        regimes = list(plain.get("regimes", {}).values())
        for distributions in (common, *(regime["variables"] for regime in regimes)):
            for name in distributions:
                if name not in space.names:
                    hint = nearest(name, space.names)
                    raise ValueError(f"the space has no variable '{name}'{hint}")
        shares = np.array([regime["share"] for regime in regimes] or [1.0])
        if (shares <= 0).any() or abs(shares.sum() - 1) > 1e-6:
            raise ValueError(f"regimes: shares must be above 0 and sum to 1, got {shares.tolist()}")
        marginals = []
        for regime in regimes or [{"variables": {}}]:
            distributions = {**common, **regime["variables"]}
            row = []
            for variable in space.variables:
                body = distributions.get(variable.name)
                row.append(uniform(variable) if body is None else marginal(variable, body))
            marginals.append(tuple(row))
        return Exposure(space, shares, tuple(marginals))

    def check(self) -> None:
        """ValueError if the constraints exclude almost all of it."""
        if not self.space.clauses:
            return
        drawn = self.points(np.random.default_rng(0).random((DRAWS, self.latent_size)))
        if not self.space.constraints.holds(self.space.categorise(drawn)).any():
            raise ValueError("the constraints exclude almost all of the exposure")

    @property
    def latent_size(self) -> int:
        return 1 + len(self.space)

    def points(self, latent: Floats) -> Floats:
        """Convert (n, 1 + d) latent numbers to (n, d) points; they may break constraints."""
        regime = np.searchsorted(np.cumsum(self.shares), latent[:, 0], side="right")
        regime = np.minimum(regime, len(self.shares) - 1)
        points = np.empty((len(latent), len(self.space)))
        for c, marginals in enumerate(self.marginals):
            rows = regime == c
            for j, each in enumerate(marginals):
                points[rows, j] = each.quantile(latent[rows, j + 1])
        return points

    def latents(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, 1 + d) latent numbers of independent points that break no constraint."""

        def draw(size: int) -> Floats:
            return rng.random((size, self.latent_size))

        if not self.space.clauses:
            return draw(count)

        def holds(latent: Floats) -> NDArray[np.bool_]:
            return self.space.constraints.holds(self.space.categorise(self.points(latent)))

        return feasible(draw, holds, count, "all of the exposure")

    def sample(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d) independent points of the exposure that break no constraint."""
        return self.points(self.latents(count, rng))

    def ratio(self, points: Floats) -> Floats:
        """How many times as likely each point is as among uniform random tests.

        With constraints, times a factor that all points share: how much they exclude of the
        exposure and of uniform tests is not known.

        Args:
            points: (n, d) feasible points.

        Returns:
            (n,) ratios.
        """
        regime_ratios = []
        for marginals in self.marginals:
            ratios = [each.ratio(points[:, j]) for j, each in enumerate(marginals)]
            regime_ratios.append(np.prod(ratios, axis=0))
        return np.asarray(self.shares @ np.array(regime_ratios))

    @property
    def largest_ratio(self) -> float:
        """An upper bound of `ratio`."""
        bounds = []
        for marginals in self.marginals:
            bounds.append(np.prod([each.largest_ratio for each in marginals]))
        return float(self.shares @ bounds)
