"""Checks a covering array independently of the code that makes it: sets of tuples, and backtracking instead of a SAT solver."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

from pipeline.core.constraints import Clause, Constraints, Literal
from pipeline.core.coverage.mixed import Mixed, all_planes
from pipeline.core.variable import Ints


@dataclass(frozen=True)
class Verification:
    """broken: (row, clause) for each row and clause that it breaks. missing: (variables, categories) of feasible cells that no other row
    covers."""

    rows: int
    cells: int
    infeasible: int
    broken: tuple[tuple[int, int], ...]
    missing: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]

    @property
    def valid(self) -> bool:
        return not self.broken and not self.missing


def verify(
    rows: Ints,
    constraints: Constraints,
    strength: int | Mixed,
    progress: Callable[[int, int], None] | None = None,
) -> Verification:
    """Check (n, d) category indices against every plane of `strength` variables, and against more planes of a mixed strength."""
    listed = [tuple(int(category) for category in row) for row in rows]
    broken = [
        (i, j)
        for i, row in enumerate(listed)
        for j, clause in enumerate(constraints.clauses)
        if not any((row[x.variable] == x.category) == x.equal for x in clause)
    ]
    out = {row for row, _ in broken}
    feasible = [row for i, row in enumerate(listed) if i not in out]
    missing, cells, infeasible = [], 0, 0
    planes = all_planes(
        len(constraints.sizes), Mixed(strength) if isinstance(strength, int) else strength
    )
    for done, (plane, wanted) in enumerate(planes.items()):
        seen = {tuple(row[v] for v in plane) for row in feasible}
        for cell in (
            product(*(range(constraints.sizes[v]) for v in plane))
            if wanted is None
            else sorted(wanted)
        ):
            if cell in seen or _feasible(constraints, dict(zip(plane, cell, strict=True))):
                cells += 1
                if cell not in seen:
                    missing.append((plane, cell))
            else:
                infeasible += 1
        if progress is not None:
            progress(done + 1, len(planes))
    return Verification(len(listed), cells, infeasible, tuple(broken), tuple(missing))


def _feasible(constraints: Constraints, fixed: Mapping[int, int]) -> bool:
    """Whether a point with the fixed categories satisfies every clause."""
    domains = {
        v: {fixed[v]} if v in fixed else set(range(constraints.sizes[v]))
        for v in constraints.named | fixed.keys()
    }
    return _search(domains, constraints.clauses)


def _search(domains: dict[int, set[int]], clauses: tuple[Clause, ...]) -> bool:
    undecided = None
    changed = True
    while changed:
        changed, undecided = False, None
        for clause in clauses:
            if any(_true(domains, literal) for literal in clause):
                continue
            possible = [literal for literal in clause if not _true(domains, _negated(literal))]
            if not possible:
                return False
            if len(possible) == 1:
                domains, changed = _with(domains, possible[0]), True
            elif undecided is None:
                undecided = possible[0]
    if undecided is None:
        return True
    return any(
        _search(_with(domains, literal), clauses) for literal in (undecided, _negated(undecided))
    )


def _true(domains: Mapping[int, set[int]], literal: Literal) -> bool:
    domain = domains[literal.variable]
    return domain == {literal.category} if literal.equal else literal.category not in domain


def _negated(literal: Literal) -> Literal:
    return Literal(literal.variable, literal.category, not literal.equal)


def _with(domains: dict[int, set[int]], literal: Literal) -> dict[int, set[int]]:
    domain = domains[literal.variable]
    return {
        **domains,
        literal.variable: domain & {literal.category}
        if literal.equal
        else domain - {literal.category},
    }
