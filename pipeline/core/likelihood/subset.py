"""Subset simulation: from ordinary tests to rare failures, level by level of the KPI."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from pipeline.core.exposure import Exposure
from pipeline.core.likelihood.estimator import Estimator
from pipeline.core.likelihood.rate import TAIL, Limits, Rate, exact
from pipeline.core.space import Floats, Ints

SHARE = 0.1
"""Share of a level's tests that begin the next level."""
LEVELS = 5
"""Levels that the budget is meant for, enough for rates from 1e-5.

In each but the first, nine tenths of the tests are new."""
ACCEPTED = 0.4
"""Share of moves that should be accepted; the width of the moves follows it."""
WIDTHS = (0.05, 0.99)
EDGE = 1e-12
UNSEEN = 2
"""Families, as large as the largest, that the upper limits allow for although no test is in them.

A failure mode may be lost on the way down."""
FLAT = "the KPI is the same in most tests, so it does not lead to failures; use monte_carlo"
SHORT = "the budget ended above the failures, so only the upper limit counts"


@dataclass(eq=False, repr=False, kw_only=True)
class SubsetSimulation(Estimator):
    """Splits a rare failure into levels of the KPI, each about a tenth as likely as the last.

    Source: Au & Beck 2001.

    The tests of the first level are drawn from the exposure. The best tenth begins Markov chains
    that stay below its worst KPI and keep the exposure's proportions; they are the next level. The
    rate is the product of the shares of all levels. It needs a KPI that falls towards failures, and
    misses a failure mode that no low KPI announces.

    The chains move in the exposure's latent numbers: numbers by a normal step of the quantile
    (Papaioannou et al. 2015), cyclic ones around the circle, regimes and categories by a new draw.
    All tests that descend from the same test of the first level are a family. Families are nearly
    independent, so the interval follows from the failures of each, see `family_limits`. An error
    counts as no failure.

    Args: those of `Estimator`.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        tenth = round(self.budget / (1 + (1 - SHARE) * (LEVELS - 1)) * SHARE)
        self._size = tenth * round(1 / SHARE)
        self._latent: list[Floats] = []
        self._states: list[Floats] = []
        self._families: Ints = np.arange(self._size)
        self._reached, self._bound, self._width = 1.0, np.inf, 0.6
        self._above = Limits(0.0, 1.0, 1.0)
        self._asked: Floats = np.zeros((0, self._exposure.latent_size))
        self._end = ""

    def ask(self) -> Floats:
        if self._end or len(self._kpi) >= self.budget:
            return self._none
        rng = self._rng()
        if not self._latent:
            self._asked = self._exposure.latents(self._size, rng)
        else:
            # A chain whose move breaks a constraint stays where it is.
            before = self._latent[-1]
            after = moved(self._exposure, before, self._width, rng)
            categories = self.space.categorise(self._exposure.points(after))
            feasible = self.space.constraints.holds(categories)
            self._asked = np.where(feasible[:, None], after, before)
        return self._exposure.points(self._asked)

    def tell(self, points: Floats, kpi: Floats) -> None:
        self.ask()  # Sets the latent values of these points, even if another instance asked.
        super().tell(points, kpi)
        if len(kpi) < len(self._asked):
            return
        state = np.where(np.isnan(kpi), np.inf, kpi)
        if not self._latent:
            self._latent, self._states = [self._asked], [state]
        else:
            accepted = state <= self._bound
            self._latent.append(np.where(accepted[:, None], self._asked, self._latent[-1]))
            self._states.append(np.where(accepted, state, self._states[-1]))
            self._width = float(np.clip(self._width * np.exp(accepted.mean() - ACCEPTED), *WIDTHS))
        if sum(map(len, self._states)) >= self._size:
            self._next_level()

    def rate(self) -> Rate:
        states, families = self._level()
        failed = states <= self.failure_threshold_s
        if not failed.any():
            return self._rate(0.0, self._above, self._end or SHORT)
        value = self._reached * float(failed.mean())
        return self._rate(value, family_limits(value, families[failed]))

    def _level(self) -> tuple[Floats, Ints]:
        """The KPIs (n,) of the current level, and their families (n,)."""
        states = np.concatenate([np.zeros(0), *self._states])[: self._size]
        return states, np.tile(self._families, max(len(self._states), 1))[: len(states)]

    def _next_level(self) -> None:
        """Begin the level below, or end if a tenth of this one has failed."""
        states, families = self._level()
        self._bound = float(np.sort(states)[round(SHARE * self._size) - 1])
        if self._bound <= self.failure_threshold_s:
            self._end = "reached"
            return
        begin = states <= self._bound
        if begin.mean() > 0.5:
            begin = states < self._bound
        if not begin.any():
            self._end = FLAT
            if self._reached == 1:
                self._above = exact(0, int(np.isfinite(states).sum()))
            return
        self._bound = float(states[begin].max())
        self._reached *= float(begin.mean())
        self._families = families[begin]
        above = family_limits(self._reached, self._families)
        self._above = Limits(0.0, above.high, above.below)
        latent = np.concatenate(self._latent)[: self._size]
        self._latent, self._states = [latent[begin]], [states[begin]]


def family_limits(value: float, families: Ints) -> Limits:
    """Limits of an estimate from failures that come in families.

    A normal interval of the logarithm with the squared relative error Σ c² / (Σ c)², where c are
    the failures of each family (Lee & Whiteley 2018, Biometrika 105:609). The upper limits also
    allow for `UNSEEN` more families.

    Args:
        value: the estimate, in (0, 1].
        families: (n,) the family of each failure, n at least 1.
    """
    counts = np.bincount(families) / len(families)
    error, more = float(np.sqrt(counts @ counts)), 1 + UNSEEN * float(counts.max())
    low, high, below = (
        value * np.exp(error * ndtri(share)) for share in (TAIL, 1 - TAIL, 1 - 2 * TAIL)
    )
    return Limits(float(low), float(min(1.0, high * more)), float(min(1.0, below * more)))


def moved(exposure: Exposure, latent: Floats, width: float, rng: np.random.Generator) -> Floats:
    """Move latent rows so that uniform rows stay uniform.

    A move and its reverse are equally likely, so a chain that rejects moves out of a region keeps
    the exposure's proportions inside it.

    Args:
        exposure: of the rows.
        latent: (n, 1 + d), in [0, 1).
        width: size of a move, in (0, 1).
        rng: source of all random draws.

    Returns:
        (n, 1 + d).
    """
    normal = ndtri(np.clip(latent, EDGE, 1 - EDGE))
    shifted = ndtr(np.sqrt(1 - width**2) * normal + width * rng.normal(size=latent.shape))
    fresh, redraw = rng.random(latent.shape), rng.random(latent.shape) < width / 2
    kinds = ["categorical"]
    kinds += ["cyclic" if v.cyclic else v.kind for v in exposure.space.variables]
    for j, kind in enumerate(kinds):
        if kind == "categorical":
            shifted[:, j] = np.where(redraw[:, j], fresh[:, j], latent[:, j])
        elif kind == "cyclic":
            shifted[:, j] = (latent[:, j] + width / 2 * (fresh[:, j] - 0.5)) % 1
    return np.asarray(np.minimum(shifted, np.nextafter(1, 0)))
