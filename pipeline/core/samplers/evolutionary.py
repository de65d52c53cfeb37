"""Evolutionary testing: the worst tests so far, changed in one variable.

Source: thesis section 4.4.2 and Table 6.1, row 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.samplers.untested import executed, fill, untested
from pipeline.core.space import Floats
from pipeline.core.variable import Variable

ATTEMPTS = 20
"""Mutations that a parent tries for one valid and untested child."""


@dataclass(eq=False, repr=False, kw_only=True)
class EvolutionarySampler(BatchSampler):
    """Mutates the tests with the lowest KPI; each batch is a generation.

    After `initial` random tests, the parents are the tests with the lowest finite KPI of all so far
    (ties: the newest first) and, as the section's exploratory extension, some other tests at
    random. Parents are mutated in turn until the batch is full. A mutation changes one variable: a
    number by a normally distributed step (at least 1 for an integer; cyclic variables wrap around,
    others stay at their bounds), a category to any other. It must be valid and untested; after
    `ATTEMPTS` failed mutations, the test is random.

    The section also lets variables with more impact change more often. Impact is the mean deviation
    of the KPI among tests that agree in all other variables; a variable without such tests has the
    mean impact of the others.

    The thesis gives no values, and does not specify the step, the order of ties or how impact is
    estimated.

    Args:
        space, seed, batch_size: as for `BatchSampler`.
        initial: n_e, in [1, 100000], rounded up to whole batches.
        parents: l, in [1, 1000]; k is the batch size divided by all parents.
        explore: random parents per parent, in [0, 1].
        step: standard deviation of a number's step as a share of its range, in (0, 1].
        impact: share of the mutations whose variable is drawn in proportion to impact, in [0, 1];
            the others draw it uniformly.

    Raises:
        ValueError: if a parameter is out of range.
    """

    initial: int = 20
    parents: int = 4
    explore: float = 0.0
    step: float = 0.1
    impact: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.limit("[1, 100000]", "initial")
        self.limit("[1, 1000]", "parents")
        self.limit("[0, 1]", "explore", "impact")
        self.limit("(0, 1]", "step")

    def _choose(self, index: int, points: Floats, kpi: Floats, rng: np.random.Generator) -> Floats:
        finite = np.isfinite(kpi)
        seen, values = points[finite], kpi[finite]
        chosen = np.zeros((0, len(self.space)))
        single = [v.kind == "categorical" and v.size == 1 for v in self.space.variables]
        changeable = 1.0 - np.array(single, float)
        if len(points) >= self.initial and len(seen) and changeable.any():
            # The lowest KPI first, the newest first among equals; then random parents.
            order = np.lexsort([-np.arange(len(values)), values])
            randoms = rng.permutation(order[self.parents :])
            randoms = randoms[: round(self.explore * self.parents)]
            parents = seen[np.concatenate([order[: self.parents], randoms])]
            uniform = changeable / changeable.sum()
            impact = impacts(seen, values) * changeable
            share = impact / impact.sum() if impact.sum() > 0 else uniform
            weights = (1 - self.impact) * uniform + self.impact * share
            chosen = self._children(parents, points, weights, rng)
        return fill(self.space, chosen, points, self.batch_size, rng)

    def _children(
        self, parents: Floats, tested: Floats, weights: Floats, rng: np.random.Generator
    ) -> Floats:
        """Valid and untested children, (n, d): at most one for each test of the batch.

        weights: (d,) probability that a mutation changes each variable.
        """
        slots = np.repeat(np.arange(self.batch_size), ATTEMPTS)
        mutated = parents[slots % len(parents)]
        changed = rng.choice(len(self.space), size=len(mutated), p=weights)
        steps, draws = self.step * rng.normal(size=len(mutated)), rng.random(len(mutated))
        for j, variable in enumerate(self.space.variables):
            rows = changed == j
            mutated[rows, j] = _moved(variable, mutated[rows, j], steps[rows], draws[rows])
        valid = self.space.constraints.holds(self.space.categorise(mutated))
        valid &= ~executed(mutated, tested)
        children = np.zeros((0, len(self.space)))
        for slot in range(self.batch_size):
            attempts = mutated[valid & (slots == slot)]
            children = np.concatenate([children, attempts[untested(attempts, children)][:1]])
        return children


def impacts(points: Floats, kpi: Floats) -> Floats:
    """The impact of each variable on the KPI.

    Impact is the mean deviation of the KPI from its mean among tests that agree in all other
    variables. A variable in which no such tests differ has the mean of the others; without any, all
    are 0.

    Args:
        points: (n, d).
        kpi: (n,), finite.

    Returns:
        (d,), at least 0.

    >>> impacts(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([1.0, 3.0])).tolist()
    [1.0, 1.0]
    """
    impact = np.full(points.shape[1], np.nan)
    for j in range(points.shape[1]):
        group = np.unique(np.delete(points, j, axis=1), axis=0, return_inverse=True)[1].ravel()
        size = np.bincount(group)
        deviation = np.abs(kpi - (np.bincount(group, kpi) / size)[group])
        alike = size[group] > 1
        if alike.any():
            impact[j] = deviation[alike].mean()
    finite = np.isfinite(impact)
    return np.where(finite, impact, impact[finite].mean() if finite.any() else 0.0)


def _moved(variable: Variable, values: Floats, steps: Floats, draws: Floats) -> Floats:
    """(n,) values changed: by `steps` of the range, or to another category by `draws` in [0, 1)."""
    if variable.kind == "categorical":
        return np.asarray((values + 1 + np.floor(draws * (variable.size - 1))) % variable.size)
    span = variable.high - variable.low
    by = steps * span
    if variable.kind == "integer":
        by = np.where(by < 0, -1, 1) * np.maximum(np.round(np.abs(by)), 1)
    if variable.cyclic:
        return np.asarray(variable.low + (values + by - variable.low) % span)
    return np.asarray(np.clip(values + by, variable.low, variable.high))
