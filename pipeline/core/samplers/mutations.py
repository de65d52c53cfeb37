"""Mutations of tests: some variables drawn anew, the others kept."""

from __future__ import annotations

import numpy as np

from pipeline.core.space import Floats, Space


def mutate(space: Space, parents: Floats, rng: np.random.Generator, most: int = 3) -> Floats:
    """Each of (n, d) parents with one to `most` variables drawn anew, (n, d); a child that breaks a constraint is a random point."""
    fresh = space.sample(len(parents), rng)
    count = rng.integers(1, min(most, len(space)) + 1, size=(len(parents), 1))
    changed = rng.random(parents.shape).argsort(axis=1) < count
    children = np.where(changed, fresh, parents)
    feasible = space.constraints.holds(space.categorise(children))
    return np.where(feasible[:, None], children, fresh)
