"""k-projection coverage: the paper's examples by its definitions, and brute force."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import combinations, product
from math import prod

import numpy as np
import pytest

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage.projection import Combine, Demand, projection_coverage

# Figure 1: d2 = d5 = d6 in cell (2, 0, 2), d1 = d4 in (1, 1, 1), d3 in (0, 2, 0).
FIGURE_1 = np.array([(1, 1, 1), (2, 0, 2), (0, 2, 0), (1, 1, 1), (2, 0, 2), (2, 0, 2)])
CUBE = (3, 3, 3)


def test_example_1_without_and_with_a_constraint() -> None:
    assert projection_coverage(FIGURE_1, Demand(Constraints(CUBE), 3)).ratio == pytest.approx(
        3 / 27
    )
    constraints = Constraints(CUBE, ((Literal(0, 0, False), Literal(1, 2)),))
    assert projection_coverage(FIGURE_1, Demand(constraints, 3)).ratio == pytest.approx(3 / 21)


def test_example_1_with_weights_by_the_definition() -> None:
    """Five of 75: (1, 1, 1) and (0, 2, 0) want a point each, (2, 0, 2) wants nine, gets three."""
    coverage = projection_coverage(
        FIGURE_1, Demand(Constraints(CUBE), 3, [[1, 1, 3], [1, 1, 1], [1, 1, 3]])
    )
    assert (coverage.covered, coverage.required) == (5, 75)


@pytest.mark.parametrize(("k", "expected"), [(1, 15 / 18), (2, 18 / 108)])
def test_example_of_definition_4(k: int, expected: float) -> None:
    assert projection_coverage(
        FIGURE_1, Demand(Constraints(CUBE), k, [[2, 2, 2]] * 3)
    ).ratio == pytest.approx(expected)


@pytest.mark.parametrize(("size", "pairs", "triples"), [(3, 1710, 30780), (4, 3040, 72960)])
def test_example_2_by_the_definition(size: int, pairs: int, triples: int) -> None:
    """Twenty conditions: the printed 1710 assumes three values each.

    These give 30780 triples, not the printed 10260.
    """
    nothing = np.zeros((0, 20), dtype=np.int64)
    assert projection_coverage(nothing, Demand(Constraints((size,) * 20), 2)).required == pairs
    assert projection_coverage(nothing, Demand(Constraints((size,) * 20), 3)).required == triples


@pytest.mark.parametrize("combine", ["product", "sum", "max"])
def test_coverage_agrees_with_brute_force(combine: Combine) -> None:
    rng = np.random.default_rng(1)
    sizes = (2, 3, 4, 2)
    folds: dict[Combine, Callable[[list[int]], int]] = {"product": prod, "sum": sum, "max": max}
    constraints = Constraints(
        sizes, ((Literal(0, 1, False), Literal(2, 3, False)), (Literal(1, 0), Literal(3, 1)))
    )
    rows = np.array(list(product(*(range(size) for size in sizes))))
    feasible = rows[constraints.holds(rows)]
    points = feasible[rng.integers(len(feasible), size=50)]
    weights = [rng.integers(0, 4, size) for size in sizes]
    for k in (1, 2, 3, 4):
        covered = required = 0
        for chosen in combinations(range(4), k):
            counts = Counter(map(tuple, points[:, chosen].tolist()))
            for cell in set(map(tuple, feasible[:, chosen].tolist())):
                weight = folds[combine](
                    [int(weights[v][c]) for v, c in zip(chosen, cell, strict=True)]
                )
                covered, required = covered + min(counts[cell], weight), required + weight
        result = projection_coverage(points, Demand(constraints, k, weights, combine))
        assert (result.covered, result.required) == (covered, required)


def test_uncountable_points_are_refused() -> None:
    constraints = Constraints(CUBE, ((Literal(0, 2, False),),))
    with pytest.raises(ValueError, match="3 points break a constraint, the first is point 1"):
        projection_coverage(FIGURE_1, Demand(constraints, 2))
    with pytest.raises(ValueError, match="coverage is undefined"):
        projection_coverage(FIGURE_1, Demand(Constraints(CUBE), 2, [[0, 0, 0]] * 3))
    with pytest.raises(ValueError, match=r"k must be in \[1, 3\], got 4"):
        projection_coverage(FIGURE_1, Demand(Constraints(CUBE), 4))
    with pytest.raises(
        ValueError, match=r"point 1: category of variable 0 must be in \[0, 2\), got 2"
    ):
        projection_coverage(FIGURE_1, Demand(Constraints((2, 3, 3)), 2))
    with pytest.raises(ValueError, match="whole numbers from 0"):
        projection_coverage(FIGURE_1, Demand(Constraints(CUBE), 2, [[1, 1, -1]] * 3))


def test_weights_that_do_not_fit_into_64_bits_are_refused() -> None:
    for k, most in ((6, 4_000), (7, 1_001)):
        weights = [[1000] * 4] * 6 if k == 6 else [[1, 1000]] * 7
        with pytest.raises(
            ValueError,
            match=f"k = {k}: the weights of a plane sum to {most:,} × .*, expected less than "
            r"2\^63",
        ):
            Demand(Constraints(tuple(map(len, weights))), k, weights)
        assert Demand(Constraints(tuple(map(len, weights))), k, weights, "sum").k == k
    nothing = np.zeros((0, 6), dtype=np.int64)
    assert (
        projection_coverage(nothing, Demand(Constraints((2,) * 6), 6, [[1, 1000]] * 6)).required
        == 1001**6
    )


def test_only_minus_one_is_an_unknown_category() -> None:
    unknown = projection_coverage(np.array([[-1, 0, 0]]), Demand(Constraints(CUBE), 1))
    assert (unknown.covered, unknown.required) == (2, 9)
    with pytest.raises(
        ValueError, match=r"point 0: category of variable 0 must be in \[0, 3\), got -2"
    ):
        projection_coverage(np.array([[-2, 0, 0]]), Demand(Constraints(CUBE), 1))
