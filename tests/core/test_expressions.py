"""Expressions and their clauses, against brute force."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.expressions import Every, Expression, Not, OneOf, Some, clauses_of

SIZES = (3, 2, 4, 2)
POINTS = list(product(*map(range, SIZES)))


def holds(expression: Expression, point: tuple[int, ...]) -> bool:
    match expression:
        case OneOf(variables, rows):
            return tuple(point[v] for v in variables) in rows
        case Every(parts):
            return all(holds(part, point) for part in parts)
        case Some(parts):
            return any(holds(part, point) for part in parts)
        case Not(part):
            return not holds(part, point)


@st.composite
def one_of(draw: st.DrawFn) -> OneOf:
    variables = tuple(draw(st.lists(st.integers(0, 3), min_size=1, max_size=3, unique=True)))
    every = list(product(*(range(SIZES[v]) for v in variables)))
    return OneOf(variables, frozenset(draw(st.lists(st.sampled_from(every), max_size=len(every)))))


def several(parts: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
    lists = st.lists(parts, max_size=3).map(tuple)
    return lists.map(Every) | lists.map(Some) | parts.map(Not)


@given(st.recursive(one_of(), several, max_leaves=6))
def test_clauses_hold_where_the_expression_holds(expression: Expression) -> None:
    expected = [holds(expression, point) for point in POINTS]
    assume(any(expected))
    clauses = clauses_of(expression, SIZES)
    assert all(clauses)
    assert Constraints(SIZES, clauses).holds(np.array(POINTS)).tolist() == expected


def test_the_clauses_of_an_implication_are_few() -> None:
    rain, dry = OneOf((2,), frozenset({(2,), (3,)})), OneOf((1,), frozenset({(0,)}))
    assert clauses_of(Some((Not(rain), dry)), SIZES) == (
        (Literal(1, 1, equal=False), Literal(2, 0), Literal(2, 1)),
    )
    assert clauses_of(Every(()), SIZES) == ()


def test_what_no_point_satisfies_and_what_is_too_large_are_refused() -> None:
    with pytest.raises(ValueError, match="no combination satisfies it"):
        clauses_of(Every((OneOf((0,), frozenset({(0,)})), OneOf((0,), frozenset()))), SIZES)
    pairs = []
    for i in range(12):
        first, second = (OneOf((2 * i + j,), frozenset({(0,)})) for j in range(2))
        pairs.append(Every((first, second)))
    with pytest.raises(ValueError, match="needs more than 1,000 clauses"):
        clauses_of(Some(tuple(pairs)), (2,) * 24)
    with pytest.raises(ValueError, match="1,000,000 combinations"):
        clauses_of(OneOf((0, 1), frozenset()), (1000, 1000))
