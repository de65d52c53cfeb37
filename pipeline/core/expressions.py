"""Logical expressions over the categories of a space, compiled to clauses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod

from pipeline.core.constraints import Clause, Literal

MOST_CLAUSES = 1_000
"""Largest number of clauses of one expression."""
TOO_MANY = f"it needs more than {MOST_CLAUSES:,} clauses; split it"
MOST_ROWS = 200_000
"""Largest number of combinations of the variables of one comparison."""


@dataclass(frozen=True)
class OneOf:
    """Together, the variables have one of the listed combinations of categories, all by index."""

    variables: tuple[int, ...]
    rows: frozenset[tuple[int, ...]]


@dataclass(frozen=True)
class Every:
    """All parts hold; without parts, this holds."""

    parts: tuple[Expression, ...]


@dataclass(frozen=True)
class Some:
    """At least one part holds; without parts, this does not hold."""

    parts: tuple[Expression, ...]


@dataclass(frozen=True)
class Not:
    """The part does not hold."""

    part: Expression


Expression = OneOf | Every | Some | Not
Wide = Mapping[int, frozenset[int]]
"""A clause: at least one of the variables has one of its categories."""


def clauses_of(expression: Expression, sizes: Sequence[int]) -> tuple[Clause, ...]:
    """Clauses that hold together exactly where the expression holds.

    sizes: number of categories of each variable. Raises ValueError if nothing satisfies the expression, and if it needs too many clauses.
    """
    found = _without_implied(_wide(expression, sizes, True))
    if any(not clause for clause in found):
        raise ValueError("no combination satisfies it")
    return tuple(_clause(clause, sizes) for clause in found)


def _clause(wide: Wide, sizes: Sequence[int]) -> Clause:
    literals: list[Literal] = []
    for variable, kept in sorted(wide.items()):
        if len(kept) == sizes[variable] - 1:
            literals.append(Literal(variable, min(set(range(sizes[variable])) - kept), equal=False))
        else:
            literals += [Literal(variable, category) for category in sorted(kept)]
    return tuple(literals)


def _wide(expression: Expression, sizes: Sequence[int], positive: bool) -> list[Wide]:
    """Clauses of the expression, or of its negation."""
    match expression:
        case Not(part):
            return _wide(part, sizes, not positive)
        case OneOf():
            return _combinations(expression, sizes, positive)
        case Every(parts) | Some(parts):
            several = [_wide(part, sizes, positive) for part in parts]
            return (
                _together(several)
                if isinstance(expression, Every) == positive
                else _either(several, sizes)
            )


def _together(several: Sequence[list[Wide]]) -> list[Wide]:
    return _bounded([clause for clauses in several for clause in clauses])


def _either(several: Sequence[list[Wide]], sizes: Sequence[int]) -> list[Wide]:
    """Clauses of a disjunction: each combines one clause of every part."""
    found: list[Wide] = [{}]
    for clauses in several:
        if len(found) * len(clauses) > 20 * MOST_CLAUSES:
            raise ValueError(TOO_MANY)
        merged = (_merged(first, second, sizes) for first, second in product(found, clauses))
        found = _without_implied([clause for clause in merged if clause is not None])
    return found


def _merged(first: Wide, second: Wide, sizes: Sequence[int]) -> Wide | None:
    """The disjunction of two clauses; None if it always holds."""
    both = dict(first)
    for variable, kept in second.items():
        both[variable] = both.get(variable, frozenset()) | kept
        if len(both[variable]) == sizes[variable]:
            return None
    return both


def _combinations(one: OneOf, sizes: Sequence[int], positive: bool) -> list[Wide]:
    """For each combination of all variables but the last one, what remains for the last; combinations that differ only in the first
    variable share a clause."""
    own = [sizes[variable] for variable in one.variables]
    if prod(own) > MOST_ROWS:
        raise ValueError(
            f"it compares variables with {prod(own):,} combinations, more than {MOST_ROWS:,}"
        )
    *before, last = one.variables
    firsts: dict[tuple[tuple[int, ...], frozenset[int]], set[int]] = {}
    alone: list[Wide] = []
    for start in product(*map(range, own[:-1])):
        kept = frozenset(
            category for category in range(own[-1]) if ((*start, category) in one.rows) == positive
        )
        if len(kept) == own[-1]:
            continue
        if start:
            firsts.setdefault((start[1:], kept), set()).add(start[0])
        else:
            alone.append({last: kept} if kept else {})
    shared = [
        _implied(before, (gone, *map(lambda c: {c}, rest)), own, (last, kept))
        for (rest, kept), gone in firsts.items()
    ]
    return _bounded(alone + shared)


def _implied(
    before: Sequence[int],
    gone: Sequence[set[int]],
    own: Sequence[int],
    then: tuple[int, frozenset[int]],
) -> Wide:
    """If the variables `before` have categories in `gone`, the last variable has one of its kept ones."""
    parts = [
        (variable, frozenset(range(size)) - excluded)
        for variable, size, excluded in zip(before, own, gone, strict=False)
    ]
    return {variable: kept for variable, kept in (*parts, then) if kept}


def _without_implied(clauses: list[Wide]) -> list[Wide]:
    """The clauses that no other clause implies."""
    kept: list[Wide] = []
    for clause in sorted(_bounded(clauses), key=lambda clause: sum(map(len, clause.values()))):
        if not any(
            all(categories <= clause.get(v, frozenset()) for v, categories in other.items())
            for other in kept
        ):
            kept.append(clause)
    return kept


def _bounded(clauses: list[Wide]) -> list[Wide]:
    if len(clauses) > MOST_CLAUSES:
        raise ValueError(TOO_MANY)
    return clauses
