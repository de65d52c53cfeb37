"""Mutations of tests: some variables drawn anew, the others kept."""

from __future__ import annotations

import numpy as np

from pipeline.core.space import Floats, Space


def mutate(space: Space, parents: Floats, rng: np.random.Generator, most: int = 3) -> Floats:
    """Draw some variables of each parent anew.

    Args:
        space: of the points.
        parents: (n, d).
        rng: source of all random draws.
        most: largest number of variables to change, at least 1.

    Returns:
        (n, d) children with one to `most` variables changed; a child that would break a constraint
        is a random point instead.
    """
    fresh = space.sample(len(parents), rng)
    count = rng.integers(1, min(most, len(space)) + 1, size=(len(parents), 1))
    changed = rng.random(parents.shape).argsort(axis=1) < count
    children = np.where(changed, fresh, parents)
    feasible = space.constraints.holds(space.categorise(children))
    return np.where(feasible[:, None], children, fresh)
