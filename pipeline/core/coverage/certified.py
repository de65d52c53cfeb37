"""Covering arrays with a proof, where integer programming finds one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.core.constraints import Constraints
from pipeline.core.coverage.arrays import QUICK, CoveringArray, Effort, covering_array
from pipeline.core.coverage.completion import Task, whole_programme
from pipeline.core.coverage.mixed import Mixed, all_planes, copy_for
from pipeline.core.coverage.problem import lay_out
from pipeline.core.space import Ints


def certified_array(
    constraints: Constraints,
    strength: int | Mixed = 2,
    *,
    seeds: Ints | None = None,
    seed: int = 0,
    effort: Effort = QUICK,
) -> CoveringArray:
    """The smallest covering array, proved by integer programming, if the domain is small enough.

    In a larger domain it is that of `covering_array`. No time goes into polishing an array that is
    proved to be the smallest.

    Args, Raises: as for `covering_array`.

    >>> array = certified_array(Constraints((2, 2, 2, 2)), 2)
    >>> array.size == array.lower_bound
    True
    """
    array = covering_array(
        constraints, strength, seeds=seeds, seed=seed, effort=replace(effort, polish_s=None)
    )
    if array.size > array.lower_bound:
        array = _proved(array, constraints, strength, seeds)
    if effort.polish_s is None or array.size == array.lower_bound:
        return array
    polished = covering_array(constraints, strength, seeds=seeds, seed=seed, effort=effort)
    fewer = min(array.rows, polished.rows, key=len)
    return replace(array, rows=fewer, lower_bound=max(array.lower_bound, polished.lower_bound))


def _proved(
    array: CoveringArray, constraints: Constraints, strength: int | Mixed, seeds: Ints | None
) -> CoveringArray:
    """The array with a better bound, or a smaller one, if there is a programme for it."""
    given = np.zeros((0, len(constraints.sizes)), np.int64) if seeds is None else seeds
    mixed = Mixed(strength) if isinstance(strength, int) else strength
    planes = all_planes(len(constraints.sizes), mixed)
    limits = copy_for(constraints, planes)
    problem = lay_out(limits, planes)
    given = np.pad(given, ((0, 0), (0, len(limits.sizes) - len(constraints.sizes))))
    task = Task(limits, problem, (problem.counts(given.astype(np.int32)) == 0).astype(np.int64))
    programme = whole_programme(task)
    if programme is None:
        return array
    added, bound = programme.solve(array.lower_bound - len(given), array.size - len(given) - 1)
    rows = array.rows if added is None else np.vstack([given, added])[:, : len(constraints.sizes)]
    return replace(array, rows=rows, lower_bound=len(given) + bound)
