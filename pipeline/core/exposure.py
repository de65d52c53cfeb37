"""The exposure: how often the conditions of a scenario space occur on the road (the density f of thesis Def. 4.11)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.core.marginals import Marginal, marginal, uniform
from pipeline.core.names import nearest
from pipeline.core.rejection import feasible
from pipeline.core.space import Floats, Space

DRAWS = 200_000
"""Draws that tell how much of a distribution the constraints leave."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """A distribution over a space: regimes such as dry, rain and fog, inside each of which all variables are independent.

    shares: (c,) of the regimes, which sum to 1. marginals: for each regime, one for each variable. Points that break a constraint do not
    occur; the others keep their proportions.

    It is drawn from latent numbers in [0, 1), (n, 1 + d): the first chooses the regime, the others are quantiles of the variables. Uniform
    latent numbers give points of the exposure.
    """

    space: Space
    shares: Floats
    marginals: tuple[tuple[Marginal, ...], ...]

    @staticmethod
    def from_dict(space: Space, plain: Mapping[str, Any]) -> Exposure:
        """The exposure of plain data, `{variables: {name: {kind, ...}}, regimes: {name: {share, variables}}}`.

        Variables that it does not name are uniform; a regime's variables replace those of the same name. ValueError for an unknown variable
        and for wrong shares.
        """
        common, regimes = plain.get("variables", {}), plain.get("regimes", {})
        for name in [
            name
            for part in (common, *(regime["variables"] for regime in regimes.values()))
            for name in part
        ]:
            if name not in space.names:
                raise ValueError(f"the space has no variable '{name}'{nearest(name, space.names)}")
        shares = np.array([regime["share"] for regime in regimes.values()] or [1.0])
        if (shares <= 0).any() or abs(shares.sum() - 1) > 1e-6:
            raise ValueError(f"regimes: shares must be above 0 and sum to 1, got {shares.tolist()}")
        named = [{**common, **regime["variables"]} for regime in regimes.values()] or [common]
        marginals = tuple(
            tuple(
                marginal(v, one[v.name]) if v.name in one else uniform(v) for v in space.variables
            )
            for one in named
        )
        return Exposure(space, shares, marginals)

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
        regime = np.minimum(
            np.searchsorted(np.cumsum(self.shares), latent[:, 0], side="right"),
            len(self.shares) - 1,
        )
        made = np.empty((len(latent), len(self.space)))
        for c, marginals in enumerate(self.marginals):
            rows = regime == c
            made[rows] = np.column_stack(
                [one.quantile(latent[rows, j + 1]) for j, one in enumerate(marginals)]
            )
        return made

    def latents(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, 1 + d) latent numbers of independent points that break no constraint."""

        def draw(size: int) -> Floats:
            return rng.random((size, self.latent_size))

        if not self.space.clauses:
            return draw(count)
        holds = self.space.constraints.holds
        return feasible(
            draw,
            lambda latent: holds(self.space.categorise(self.points(latent))),
            count,
            "all of the exposure",
        )

    def sample(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d) independent points of the exposure that break no constraint."""
        return self.points(self.latents(count, rng))

    def ratio(self, points: Floats) -> Floats:
        """How many times as likely each of (n, d) feasible points is as among uniform random tests, (n,). With constraints, times a factor
        that all points share: how much they exclude of the exposure and of uniform tests is not known."""
        columns = list(range(len(self.space)))
        each = [
            np.prod([one[j].ratio(points[:, j]) for j in columns], axis=0) for one in self.marginals
        ]
        return np.asarray(self.shares @ np.array(each))

    @property
    def largest_ratio(self) -> float:
        """A bound of `ratio`."""
        return float(
            self.shares
            @ [np.prod([one.largest_ratio for one in marginals]) for marginals in self.marginals]
        )
