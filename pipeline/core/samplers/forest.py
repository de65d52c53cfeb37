"""Forest-guided testing: failures that differ, where a forest of trees expects them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.failure_model import joined, linear_chances, tree_chances
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.coverage import propose_categories
from pipeline.core.samplers.features import features
from pipeline.core.samplers.mutations import mutate
from pipeline.core.samplers.untested import fill, untested
from pipeline.core.space import Floats, Ints

ENOUGH_FAILURES = 5
"""Failures from which only failures are mutated."""
PARENTS = 10
"""Tests that are mutated while there are fewer failures."""
CURIOSITY = 0.2
"""Added to the failure probability in slots that explore, so that a pair counts even where no failure is expected."""


@dataclass(eq=False, repr=False, kw_only=True)
class ForestSampler(BatchSampler):
    """Chooses each batch greedily for expected failures in pairs of categories that have not failed yet.

    The first batch covers as many pairs of categories as it can. From then on, candidates are random points, mutations of failures, and
    failures with other categories; the value of a candidate is P(failure) x (gain + exploitation x s^2), where s is the share of pairs of
    categories that have failed. So the search turns to certain failures as new pairs run out.

    P comes from two models. Extremely randomised trees (Geurts et al., 2006) learn which tests failed, and know how variables act
    together. A Bayesian linear regression of the KPI (Tipping, 2001) learns from near misses, too, so it leads while failures are few. They
    are combined as a noisy-or: tests that the trees know to fail gain nothing from the linear model, which would prefer tests that combine
    all causes. For each pick, a new sample of trees is drawn (Thompson sampling): where the trees disagree, picks differ.

    The gain is the mean of 1 / (1 + n)^2 over the candidate's pairs of categories, n being the number of failures that show the pair,
    expected failures of the batch included. So a known failure mode loses value, but never all of it.

    candidates: number of random points and mutations. mutants: the share of mutations, in [0, 1]. swaps: number of failures whose
    categorical values are drawn anew, as further candidates. kinds: share of a batch whose gain counts pairs of categorical variables
    alone, without exploitation. explore: share of a batch for pairs never tested. explore_until: share of all pairs that, once tested, ends
    this. exploitation: see above. diverse: false counts expected failures alone, so the search stays in the first failure modes. trees:
    size of the forest. votes: trees of a pick. failure_threshold_s: a KPI at or below it is a failure. earlier: points (m, d) and KPI (m,)
    of each earlier campaign on another scenario; both models learn from them, too.
    """

    candidates: int = 3000
    mutants: float = 0.1
    swaps: int = 600
    kinds: float = 0.25
    explore: float = 0.05
    explore_until: float = 0.5
    exploitation: float = 6.0
    diverse: bool = True
    trees: int = 60
    votes: int = 20
    failure_threshold_s: float = 0.1
    earlier: Sequence[tuple[Floats, Floats]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.candidates < self.batch_size:
            raise ValueError(f"candidates must be at least batch_size, {self.batch_size}, got {self.candidates}")
        self.limit("[1, 100000]", "candidates")
        self.limit("[0, 1]", "mutants", "kinds", "explore", "explore_until")
        self.limit("[0, 100000]", "swaps")
        self.limit("[0, 1000]", "exploitation")
        self.limit("[1, 1000]", "trees")
        self.limit("(0, 10]", "failure_threshold_s")
        if not 1 <= self.votes <= self.trees:
            raise ValueError(f"votes must be in [1, trees], [1, {self.trees}], got {self.votes}")

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        inputs, observed = self._lessons(points, kpi)
        if not len(observed) or (observed == observed[0]).all():
            covering = propose_categories(self.space, 2, self.space.categorise(points), self.batch_size, rng)
            candidates = self.space.within(covering, rng)
            return fill(self.space, candidates[untested(candidates, points)], points, self.batch_size, rng)
        candidates = self._candidate_set(points, kpi, rng)
        if len(candidates) < self.batch_size:
            return fill(self.space, candidates, points, self.batch_size, rng)
        votes = self._votes(inputs, observed, self._inputs(candidates, len(self.earlier)), rng)
        return candidates[self._pick(candidates, votes, points, kpi <= self.failure_threshold_s, rng)]

    def _lessons(self, points: Floats, kpi: Floats) -> tuple[Floats, Floats]:
        """Inputs (n, f) and KPI (n,) of all tests without an error, those of earlier campaigns first."""
        campaigns = [*self.earlier, (points, kpi)]
        inputs = [self._inputs(tests[~np.isnan(values)], i) for i, (tests, values) in enumerate(campaigns)]
        return np.concatenate(inputs), np.concatenate([values[~np.isnan(values)] for _, values in campaigns])

    def _votes(self, inputs: Floats, kpi: Floats, others: Floats, rng: np.random.Generator) -> Floats:
        """The failure probability of other inputs (m, f) by each tree, joined with the linear model's, (trees, m)."""
        known = tree_chances(inputs, kpi <= self.failure_threshold_s, others, self.trees, rng)
        return joined(known, self._linear(inputs, kpi, others))

    def _linear(self, inputs: Floats, kpi: Floats, others: Floats) -> Floats:
        """The probability (m,) that the KPI of other inputs is at or below the threshold, by a linear model with normal scatter."""
        return linear_chances(inputs, kpi, self.failure_threshold_s, others)

    def _inputs(self, points: Floats, campaign: int) -> Floats:
        """The models' inputs (n, f): features of the points and, with earlier campaigns, the campaign one-hot."""
        inputs = features(self.space, points)
        if not self.earlier:
            return inputs
        own = np.zeros((len(points), len(self.earlier) + 1))
        own[:, campaign] = 1
        return np.hstack([inputs, own])

    def _candidate_set(self, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        """Random points, mutations and swaps, (n, d) with n up to `candidates` + `swaps`; none twice, none tested."""
        order = np.argsort(np.where(np.isnan(kpi), np.inf, kpi), kind="stable")
        failures = int((kpi <= self.failure_threshold_s).sum())
        parents = points[order[: failures if failures >= ENOUGH_FAILURES else PARENTS]]
        count = round(self.mutants * self.candidates) if len(parents) else 0
        children = mutate(self.space, parents[rng.integers(len(parents), size=count)], rng) if count else points[:0]
        drawn = np.concatenate([self.space.sample(self.candidates - count, rng), children, self._swapped(points[order[:failures]], rng)])
        return drawn[untested(drawn, points)]

    def _swapped(self, failures: Floats, rng: np.random.Generator) -> Floats:
        """Failures drawn from (n, d) with all categorical values drawn anew, (m, d) with m up to `swaps`: does it fail with others, too?"""
        if not (self.swaps and len(failures)):
            return failures[:0]
        categorical = [variable.kind == "categorical" for variable in self.space.variables]
        drawn = failures[rng.integers(len(failures), size=self.swaps)]
        swapped = np.where(categorical, self.space.sample(self.swaps, rng), drawn)
        return swapped[self.space.constraints.holds(self.space.categorise(swapped))]

    def _pick(self, candidates: Floats, votes: Floats, points: Floats, failed: NDArray[np.bool_], rng: np.random.Generator) -> Ints:
        """Positions of the `batch_size` candidates to test. votes: (trees, n) failure probability by each tree."""
        pairs, tested = self._pairs(candidates), self._pairs(points)
        shown, untested = np.zeros(self._pair_count), np.ones(self._pair_count)
        np.add.at(shown, tested[failed].ravel(), 1.0)
        untested[tested.ravel()] = 0
        free, expected, chosen = np.ones(len(candidates), dtype=bool), votes.mean(axis=0), []
        explored = round(self.explore * self.batch_size) if untested.mean() > 1 - self.explore_until else 0
        kinds = round(self.kinds * self.batch_size)
        worth = self.exploitation * float((shown > 0).mean()) ** 2
        for slot in range(self.batch_size):
            chance = votes[rng.integers(len(votes), size=self.votes)].mean(axis=0) if self.diverse else expected
            if slot < explored:
                value = untested[pairs].mean(axis=1) * (CURIOSITY + chance)
            elif not self.diverse:
                value = chance
            elif slot < self.batch_size - kinds:
                value = chance * ((1 / (1 + shown) ** 2)[pairs].mean(axis=1) + worth)
            else:
                value = chance * (1 / (1 + shown) ** 2)[pairs[:, self._categorical]].mean(axis=1)
            best = int(np.argmax(np.where(free, value, -1.0)))
            chosen.append(best)
            free[best] = False
            shown[pairs[best]] += expected[best]
            untested[pairs[best]] = 0
        return np.array(chosen)

    def _pairs(self, points: Floats) -> Ints:
        """The pairs of categories that each of (n, d) points shows, (n, pairs), as positions among `_pair_count`."""
        categories, sizes = self.space.categorise(points), self.space.sizes
        if len(sizes) == 1:
            return categories
        cells = [categories[:, i] * sizes[j] + categories[:, j] for i, j in combinations(range(len(sizes)), 2)]
        return np.column_stack(cells) + self._offsets

    @cached_property
    def _offsets(self) -> Ints:
        """Position of the first cell of each pair of variables."""
        cells = [a * b for a, b in combinations(self.space.sizes, 2)]
        return np.cumsum([0, *cells[:-1]])

    @property
    def _pair_count(self) -> int:
        sizes = self.space.sizes
        return sizes[0] if len(sizes) == 1 else sum(a * b for a, b in combinations(sizes, 2))

    @cached_property
    def _categorical(self) -> NDArray[np.bool_]:
        """(pairs,) those of two categorical variables; all pairs where there is none."""
        categorical = [variable.kind == "categorical" for variable in self.space.variables]
        both = np.array([a and b for a, b in combinations(categorical, 2)] or [True])
        return both if both.any() else np.ones_like(both)
