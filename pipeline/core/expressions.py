"""Logical expressions over the categories of a space, compiled to clauses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, product
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
    """The clauses that hold together exactly where an expression holds.

    Args:
        expression: over the indices of variables and categories.
        sizes: (d,) number of categories of each variable.

    Raises:
        ValueError: nothing satisfies the expression, or it needs too many clauses.

    >>> clauses_of(Not(OneOf((0,), frozenset({(1,)}))), [3])
    ((Literal(variable=0, category=1, equal=False),),)
    """
    clauses = _without_implied(_wide(expression, sizes, True))
    if any(not clause for clause in clauses):
        raise ValueError("no combination satisfies it")
    return tuple(_clause(clause, sizes) for clause in clauses)


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
            if isinstance(expression, Every) != positive:
                return _either(several, sizes)
            return _bounded(list(chain.from_iterable(several)))


def _either(several: Sequence[list[Wide]], sizes: Sequence[int]) -> list[Wide]:
    """Clauses of a disjunction: each combines one clause of every part."""
    combined: list[Wide] = [{}]
    for clauses in several:
        if len(combined) * len(clauses) > 20 * MOST_CLAUSES:
            raise ValueError(TOO_MANY)
        merged = (_merged(first, second, sizes) for first, second in product(combined, clauses))
        combined = _without_implied([clause for clause in merged if clause is not None])
    return combined


def _merged(first: Wide, second: Wide, sizes: Sequence[int]) -> Wide | None:
    """The disjunction of two clauses; None if it always holds."""
    both = dict(first)
    for variable, kept in second.items():
        both[variable] = both.get(variable, frozenset()) | kept
        if len(both[variable]) == sizes[variable]:
            return None
    return both


def _combinations(relation: OneOf, sizes: Sequence[int], positive: bool) -> list[Wide]:
    """Clauses of a relation: each combination of all variables but the last limits the last.

    Combinations that differ only in the first variable share a clause.
    """
    *before, last = relation.variables
    counts = [sizes[variable] for variable in relation.variables]
    if prod(counts) > MOST_ROWS:
        raise ValueError(
            f"it compares variables with {prod(counts):,} combinations, more than {MOST_ROWS:,}"
        )
    shared: dict[tuple[tuple[int, ...], frozenset[int]], set[int]] = {}
    clauses: list[Wide] = []
    for start in product(*map(range, counts[:-1])):
        kept = frozenset(
            category
            for category in range(counts[-1])
            if ((*start, category) in relation.rows) == positive
        )
        if len(kept) == counts[-1]:
            continue
        if start:
            shared.setdefault((start[1:], kept), set()).add(start[0])
        else:
            clauses.append({last: kept} if kept else {})
    # If the variables before have the excluded categories, the last one has one of its kept ones.
    for (rest, kept), firsts in shared.items():
        clause: dict[int, frozenset[int]] = {}
        excluded = (firsts, *({category} for category in rest))
        for variable, size, categories in zip(before, counts, excluded, strict=False):
            clause[variable] = frozenset(range(size)) - categories
        clause[last] = kept
        clauses.append(
            {variable: categories for variable, categories in clause.items() if categories}
        )
    return _bounded(clauses)


def _without_implied(clauses: list[Wide]) -> list[Wide]:
    """The clauses that no other clause implies."""
    kept: list[Wide] = []
    for clause in sorted(_bounded(clauses), key=lambda clause: sum(map(len, clause.values()))):
        for other in kept:
            if all(categories <= clause.get(v, frozenset()) for v, categories in other.items()):
                break
        else:
            kept.append(clause)
    return kept


def _bounded(clauses: list[Wide]) -> list[Wide]:
    if len(clauses) > MOST_CLAUSES:
        raise ValueError(TOO_MANY)
    return clauses
