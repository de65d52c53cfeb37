"""Feasibility against brute force."""

from __future__ import annotations

import re
from itertools import product
from typing import Any

import numpy as np
import pytest
from pysat.solvers import Solver

from pipeline.core import constraints
from pipeline.core.constraints import Constraints, Literal, contradiction
from pipeline.core.space import Space
from tests.spaces import SMALL, THESIS

SIZES = (3, 2, 3, 2)


def random_constraints(rng: np.random.Generator) -> Constraints:
    def literal() -> Literal:
        variable = int(rng.integers(len(SIZES)))
        return Literal(variable, int(rng.integers(SIZES[variable])), bool(rng.integers(2)))

    clauses = []
    for _ in range(rng.integers(0, 9)):
        clauses.append(tuple(literal() for _ in range(rng.integers(1, 4))))
    return Constraints(SIZES, tuple(clauses))


@pytest.mark.parametrize("paired", [constraints.PAIRED, 1])
def test_feasible_cells_agree_with_brute_force(
    paired: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(constraints, "PAIRED", paired)
    rng = np.random.default_rng(0)
    rows = np.array(list(product(*(range(size) for size in SIZES))))
    for _ in range(60):
        limits = random_constraints(rng)
        feasible = rows[limits.holds(rows)]
        for pair in ((0, 1), (1, 2), (0, 3), (3, 1)):
            expected = np.zeros([SIZES[v] for v in pair], bool)
            expected[feasible[:, pair[0]], feasible[:, pair[1]]] = True
            assert np.array_equal(limits.feasible_cells(pair), expected)


def test_a_contradiction_takes_one_solver_and_leaves_out_the_first_constraints_that_it_can(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    solvers = []

    def solver(**given: Any) -> Any:
        solvers.append(given)
        return Solver(**given)

    monkeypatch.setattr(constraints, "Solver", solver)
    chain = [[(Literal(i, 0), Literal(i + 1, 1))] for i in range(99)]
    ends = [[(Literal(0, 1),)], [(Literal(0, 0),)], [(Literal(99, 0),)]]
    # The chain contradicts its ends, and so do the two constraints on its beginning, which come
    # before its end.
    assert contradiction((2,) * 100, [*chain, *ends]) == (99, 100) and len(solvers) == 1
    assert contradiction((2,) * 100, [ends[0], ends[1], *chain, ends[2]]) == (0, *range(2, 102))
    assert len(solvers) == 2


def test_complete_gives_a_feasible_row_that_agrees() -> None:
    limits = Space(SMALL.variables, (("kind != a", "x = 3"), ("kind = a",))).constraints
    row = limits.complete({2: 4})
    assert row is not None and row[2] == 4 and limits.holds(np.array([row])).all()
    assert limits.complete({0: 2}) is None


def test_an_empty_clause_leaves_no_point() -> None:
    assert not Constraints((2, 2), ((),)).feasible_cells([0, 1]).any()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "kind",
            "a constraint must read 'variable = category' or 'variable != category', got 'kind'",
        ),
        (
            "fog = 3",
            "constraint 'fog = 3': variable must be one of x, angle, count, kind; got 'fog'",
        ),
        ("kind = d", "constraint 'kind = d': category must be one of a, b, c; got 'd'"),
        (
            "count = 1.4",
            "constraint 'count = 1.4': category must be one of 1, 2, 3, 4, 5; got '1.4'; did you "
            "mean '1'?",
        ),
        (
            "angle = 100",
            "category must be one of 0, 30, 60, 90, 120, 150, 180, 210, 240, 270, 300, 330; got "
            "'100'; did you mean '90'?",
        ),
    ],
)
def test_a_wrong_literal_is_named(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message) + "$"):
        Space(SMALL.variables, ((text,),))


def test_a_wrong_name_gets_a_suggestion_by_spelling() -> None:
    blueprints = THESIS.variables[-1:]
    with pytest.raises(
        ValueError, match=r"category must be one of .*M 33.*, …; got 'M33'; did you mean 'M 33'\?$"
    ):
        Space(blueprints, (("blueprint != M33",),))


def test_indices_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match=r"category of variable 1 must be in \[0, 2\), got 2"):
        Constraints((2, 2), ((Literal(1, 2),),))
