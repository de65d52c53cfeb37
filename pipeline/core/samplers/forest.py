"""Forest-guided testing: failures that differ, where a forest of trees expects them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.failure_model import Chances, joined, linear_chances, tree_chances
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.coverage import propose_categories
from pipeline.core.samplers.features import features
from pipeline.core.samplers.mutations import mutate
from pipeline.core.samplers.untested import fill, untested
from pipeline.core.space import Floats, Ints

ENOUGH_FAILURES = 5
"""With this many failures, only failures are mutated."""
PARENTS = 10
"""Tests that are mutated while there are fewer failures."""
REFINED = 40
"""Candidates mutated in a refinement: as many of the best for pairs, and of the best for kinds."""
CHILDREN = 5
"""Mutations of each of them."""
CURIOSITY = 0.2
"""Added to the failure probability in slots that explore.

So a pair counts even where no failure is expected."""


@dataclass(eq=False, repr=False, kw_only=True)
class ForestSampler(BatchSampler):
    """Chooses each batch greedily for expected failures in pairs that have not failed yet.

    A pair is two categories of different variables. The first batch covers as many pairs as it
    can. From then on, candidates are random points, then mutations of the best candidates and of
    failures, refinement by refinement. The value of a candidate is
    P(failure) x (gain + exploitation x s^2), where s is the share of pairs that have failed. So the
    search turns to certain failures as new pairs run out.

    P comes from two models. Extremely randomised trees (Geurts et al., 2006) learn which tests
    failed, and represent how variables act together. A Bayesian linear regression of the KPI
    (Tipping, 2001) learns from near misses, too, so it leads while failures are few. They are
    combined as a noisy-or: tests that the trees expect to fail gain nothing from the linear model,
    which would prefer tests that combine all causes. For each pick, a new sample of trees is drawn
    (Thompson sampling): where the trees disagree, picks differ.

    The gain is the mean of 1 / (1 + n)^2 over the candidate's pairs, n being the number of failures
    that show the pair, expected failures of the batch included. So a kind of failure that has been
    seen loses value, but never all of it.

    Args:
        space, seed, batch_size: as for `BatchSampler`.
        candidates: number of candidates before the first refinement, in [batch_size, 100000].
        mutants: share of the candidates that are mutations of failures, in [0, 1].
        refinements: how often the best are mutated, in [0, 1000].
        kinds: share of a batch whose gain counts pairs of categorical variables alone, without
            exploitation, in [0, 1].
        explore: share of a batch for pairs never tested, in [0, 1].
        explore_until: share of all pairs that, once tested, ends this, in [0, 1].
        exploitation: factor of s^2 above, in [0, 1000].
        diverse: False counts expected failures alone, so the search stays in the first failure
            modes.
        trees: size of the forest, in [1, 1000].
        votes: trees of a pick, in [1, trees].
        failure_threshold_s: a KPI at or below it is a failure, in (0, 10] s.
        earlier: points (m, d) and KPI (m,) of each earlier campaign on another scenario; both
            models learn from them, too.

    Raises:
        ValueError: if a parameter is out of range.

    >>> from pipeline.core.space import Space, Variable
    >>> space = Space((Variable("x", "continuous", "m", 0, 10, 1),))
    >>> sampler = ForestSampler(space, seed=0, batch_size=5)
    >>> points = sampler.ask()
    >>> sampler.tell(points, kpi=points[:, 0])
    >>> sampler.ask().shape
    (5, 1)
    """

    candidates: int = 1000
    mutants: float = 0.0
    refinements: int = 8
    kinds: float = 0.25
    explore: float = 0.05
    explore_until: float = 0.5
    exploitation: float = 6.0
    diverse: bool = True
    trees: int = 45
    votes: int = 20
    failure_threshold_s: float = 0.1
    earlier: Sequence[tuple[Floats, Floats]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.candidates < self.batch_size:
            raise ValueError(
                f"candidates must be at least batch_size, {self.batch_size}, got {self.candidates}"
            )
        self.limit("[1, 100000]", "candidates")
        self.limit("[0, 1]", "mutants", "kinds", "explore", "explore_until")
        self.limit("[0, 1000]", "refinements", "exploitation")
        self.limit("[1, 1000]", "trees")
        self.limit("(0, 10]", "failure_threshold_s")
        if not 1 <= self.votes <= self.trees:
            raise ValueError(f"votes must be in [1, trees], [1, {self.trees}], got {self.votes}")

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        inputs, observed = self._lessons(points, kpi)
        if not len(observed) or (observed == observed[0]).all():
            tested = self.space.categorise(points)
            covering = propose_categories(self.space, 2, tested, self.batch_size, rng)
            candidates = self.space.within(covering, rng)
            candidates = candidates[untested(candidates, points)]
            return fill(self.space, candidates, points, self.batch_size, rng)
        candidates = self._candidate_set(points, kpi, rng)
        if len(candidates) < self.batch_size:
            return fill(self.space, candidates, points, self.batch_size, rng)
        failed = kpi <= self.failure_threshold_s
        votes_of = self._learn(inputs, observed, rng)
        candidates, votes = self._refined(candidates, points, failed, votes_of, rng)
        return candidates[self._pick(candidates, votes, points, failed, rng)]

    def _lessons(self, points: Floats, kpi: Floats) -> tuple[Floats, Floats]:
        """Inputs (n, f) and KPI (n,) of tests without an error, earlier campaigns first."""
        inputs, observed = [], []
        for campaign, (tests, values) in enumerate([*self.earlier, (points, kpi)]):
            valid = ~np.isnan(values)
            inputs.append(self._inputs(tests[valid], campaign))
            observed.append(values[valid])
        return np.concatenate(inputs), np.concatenate(observed)

    def _learn(self, inputs: Floats, kpi: Floats, rng: np.random.Generator) -> Chances:
        """The failure probability by each tree, joined with the linear model's, (trees, m)."""
        trees = tree_chances(inputs, kpi <= self.failure_threshold_s, self.trees, rng)
        linear = linear_chances(inputs, kpi, self.failure_threshold_s)
        return lambda others: joined(trees(others), linear(others))

    def _inputs(self, points: Floats, campaign: int) -> Floats:
        """The models' inputs (n, f): features and, with earlier campaigns, the campaign one-hot."""
        inputs = features(self.space, points)
        if not self.earlier:
            return inputs
        one_hot = np.zeros((len(points), len(self.earlier) + 1))
        one_hot[:, campaign] = 1
        return np.hstack([inputs, one_hot])

    def _candidate_set(self, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        """Random points and mutations, (n, d), n up to `candidates`; none twice, none tested."""
        order = np.argsort(np.where(np.isnan(kpi), np.inf, kpi), kind="stable")
        failures = int((kpi <= self.failure_threshold_s).sum())
        parents = points[order[: failures if failures >= ENOUGH_FAILURES else PARENTS]]
        count = round(self.mutants * self.candidates) if len(parents) else 0
        children = points[:0]
        if count:
            children = mutate(self.space, parents[rng.integers(len(parents), size=count)], rng)
        drawn = np.concatenate([self.space.sample(self.candidates - count, rng), children])
        return drawn[untested(drawn, points)]

    def _refined(
        self,
        candidates: Floats,
        points: Floats,
        failed: NDArray[np.bool_],
        votes_of: Chances,
        rng: np.random.Generator,
    ) -> tuple[Floats, Floats]:
        """The candidates, with mutations of the best of them and of failures; none tested.

        Also returns the votes on each, (trees, n).
        """
        shown = self._shown(points[failed])
        refined = np.concatenate([candidates, points[failed]])
        votes = votes_of(self._inputs(refined, len(self.earlier)))
        values = self._values(refined, votes, shown)
        for _ in range(self.refinements):
            best = np.unique(np.argsort(-values, axis=1, kind="stable")[:, :REFINED])
            children = mutate(self.space, np.repeat(refined[best], CHILDREN, axis=0), rng)
            new = votes_of(self._inputs(children, len(self.earlier)))
            refined, votes = np.concatenate([refined, children]), np.hstack([votes, new])
            values = np.hstack([values, self._values(children, new, shown)])
        kept = untested(refined, points)
        return refined[kept], votes[:, kept]

    def _values(self, points: Floats, votes: Floats, shown: Floats) -> Floats:
        """What points (n, d) are worth in slots for pairs and in slots for kinds, (2, n)."""
        chance, pairs = votes.mean(axis=0), self._pairs(points)
        if not self.diverse:
            return np.stack([chance, chance])
        for_pairs = self._gain(pairs, shown) + self._worth(shown)
        for_kinds = self._gain(pairs[:, self._categorical], shown)
        return np.asarray(chance * np.stack((for_pairs, for_kinds)))

    def _pick(
        self,
        candidates: Floats,
        votes: Floats,
        points: Floats,
        failed: NDArray[np.bool_],
        rng: np.random.Generator,
    ) -> Ints:
        """Positions of the `batch_size` candidates to test.

        votes: (trees, n) failure probability of each candidate by each tree.
        """
        pairs, tested = self._pairs(candidates), self._pairs(points)
        shown, untested = self._shown(points[failed]), self._possible.astype(float)
        untested[tested.ravel()] = 0
        free, expected, chosen = np.ones(len(candidates), dtype=bool), votes.mean(axis=0), []
        explored = 0
        if untested[self._possible].mean() > 1 - self.explore_until:
            explored = round(self.explore * self.batch_size)
        kinds, worth = round(self.kinds * self.batch_size), self._worth(shown)
        for slot in range(self.batch_size):
            chance = expected
            if self.diverse:
                chance = votes[rng.integers(len(votes), size=self.votes)].mean(axis=0)
            if slot < explored:
                value = untested[pairs].mean(axis=1) * (CURIOSITY + chance)
            elif not self.diverse:
                value = chance
            elif slot < self.batch_size - kinds:
                value = chance * (self._gain(pairs, shown) + worth)
            else:
                value = chance * self._gain(pairs[:, self._categorical], shown)
            best = int(np.argmax(np.where(free, value, -1.0)))
            chosen.append(best)
            free[best] = False
            shown[pairs[best]] += expected[best]
            untested[pairs[best]] = 0
        return np.array(chosen)

    @staticmethod
    def _gain(pairs: Ints, shown: Floats) -> Floats:
        """The mean gain (n,) of pairs (n, p), given the number of failures that show each pair."""
        return np.asarray((1 / (1 + shown) ** 2)[pairs].mean(axis=1))

    def _worth(self, shown: Floats) -> float:
        """What a failure is worth beside its gain."""
        return self.exploitation * float((shown > 0)[self._possible].mean()) ** 2

    def _shown(self, failures: Floats) -> Floats:
        """How many of the failures (n, d) show each pair of categories."""
        pairs = self._pairs(failures).ravel()
        return np.bincount(pairs, minlength=len(self._possible)).astype(float)

    def _pairs(self, points: Floats) -> Ints:
        """The pairs of categories that each of (n, d) points shows, (n, pairs).

        They are positions in `_possible`. With a single variable, its categories are the pairs.
        """
        categories, sizes = self.space.categorise(points), self.space.sizes
        if len(sizes) == 1:
            return categories
        cells, offset = [], 0
        for i, j in combinations(range(len(sizes)), 2):
            cells.append(offset + categories[:, i] * sizes[j] + categories[:, j])
            offset += sizes[i] * sizes[j]
        return np.column_stack(cells)

    @cached_property
    def _possible(self) -> NDArray[np.bool_]:
        """Whether some feasible point shows each pair of categories."""
        d, constraints = len(self.space), self.space.constraints
        planes = combinations(range(d), min(2, d))
        return np.concatenate([constraints.feasible_cells(plane).ravel() for plane in planes])

    @cached_property
    def _categorical(self) -> NDArray[np.bool_]:
        """(pairs,) whether both variables are categorical; all True if no pair is of that kind."""
        categorical = [variable.kind == "categorical" for variable in self.space.variables]
        both = np.array([a and b for a, b in combinations(categorical, 2)] or [True])
        return both if both.any() else np.ones_like(both)
