"""Checks a covering array independently of the code that makes it.

It uses sets of tuples, and backtracking instead of a SAT solver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from pipeline.core.constraints import Clause, Constraints, Literal
from pipeline.core.coverage.mixed import Mixed, all_planes
from pipeline.core.variable import Ints


@dataclass(frozen=True)
class Verification:
    """The result of a check.

    Attributes:
        rows: number of rows.
        cells: number of feasible cells.
        infeasible: number of infeasible cells.
        broken: (row, clause) for each row and each clause that it breaks.
        missing: (variables, categories) of feasible cells that no feasible row covers.
    """

    rows: int
    cells: int
    infeasible: int
    broken: tuple[tuple[int, int], ...]
    missing: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]

    @property
    def valid(self) -> bool:
        """Whether no row breaks a clause and no feasible cell is missing."""
        return not self.broken and not self.missing


def verify(
    rows: Ints,
    constraints: Constraints,
    strength: int | Mixed,
    progress: Callable[[int, int], None] | None = None,
) -> Verification:
    """Check rows against every plane of a strength.

    Args:
        rows: (n, d) category indices.
        constraints: over the d variables.
        strength: t, alone or with more planes.
        progress: called with the planes checked and the number of planes.

    >>> verify(np.array([[0, 0], [0, 1], [1, 1]]), Constraints((2, 2)), 2).missing
    (((0, 1), (1, 0)),)
    """
    listed = [tuple(map(int, row)) for row in rows]
    broken: list[tuple[int, int]] = []
    feasible = []
    for i, row in enumerate(listed):
        before = len(broken)
        for j, clause in enumerate(constraints.clauses):
            satisfied = {(row[x.variable] == x.category) == x.equal for x in clause}
            if True not in satisfied:
                broken.append((i, j))
        if len(broken) == before:
            feasible.append(row)
    covering = np.array(feasible, np.int64).reshape(-1, len(constraints.sizes))
    domains = {v: set(range(constraints.sizes[v])) for v in constraints.named}
    missing, cells, infeasible = [], 0, 0
    mixed = Mixed(strength) if isinstance(strength, int) else strength
    planes = all_planes(len(constraints.sizes), mixed)
    for done, (plane, wanted) in enumerate(planes.items()):
        seen = set(map(tuple, covering[:, list(plane)].tolist()))
        every = product(*(range(constraints.sizes[v]) for v in plane))
        for cell in every if wanted is None else sorted(wanted):
            fixed = {v: {category} for v, category in zip(plane, cell, strict=True)}
            if cell in seen or _search(domains | fixed, constraints.clauses):
                cells += 1
                if cell not in seen:
                    missing.append((plane, cell))
            else:
                infeasible += 1
        if progress is not None:
            progress(done + 1, len(planes))
    return Verification(len(listed), cells, infeasible, tuple(broken), tuple(missing))


def _search(domains: dict[int, set[int]], clauses: tuple[Clause, ...]) -> bool:
    """Whether the domains hold a point that satisfies every clause."""
    undecided, changed = None, True
    while changed:
        changed, undecided = False, None
        for clause in clauses:
            if any(domains[x.variable] == _with(domains, x)[x.variable] for x in clause):
                continue
            possible = [literal for literal in clause if _with(domains, literal)[literal.variable]]
            if not possible:
                return False
            if len(possible) == 1:
                domains, changed = _with(domains, possible[0]), True
            elif undecided is None:
                undecided = possible[0]
    if undecided is None:
        return True
    negated = Literal(undecided.variable, undecided.category, not undecided.equal)
    return any(_search(_with(domains, literal), clauses) for literal in (undecided, negated))


def _with(domains: dict[int, set[int]], literal: Literal) -> dict[int, set[int]]:
    """The domains without the points that break a literal."""
    domain = domains[literal.variable]
    category = {literal.category}
    return {**domains, literal.variable: domain & category if literal.equal else domain - category}
