"""The encoding of scenario spaces."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pipeline.core.space import Space, Variable
from pipeline.errors import InputError
from tests.spaces import CONSTRAINED, CUT, SMALL, THESIS


def test_sizes_of_the_thesis_space() -> None:
    assert THESIS.sizes == (11, 11, 12, 12, 11, 13, 6, 74)


def test_values_belong_to_the_nearest_category_and_cyclic_values_wrap_around() -> None:
    azimuth, rain = THESIS.variables[2], THESIS.variables[0]
    assert azimuth.categorise(np.array([0.0, 14, 16, 344, 346, 360])).tolist() == [
        0,
        0,
        1,
        11,
        0,
        0,
    ]
    assert rain.categorise(np.array([0.0, 4, 6, 94, 96, 100])).tolist() == [0, 0, 1, 9, 10, 10]


def test_integers_are_equally_frequent_also_on_a_circle() -> None:
    unit = (np.arange(12) + 0.5) / 12
    assert (
        Variable("day", "integer", "", 1, 5, 1, cyclic=True).scale(unit).tolist()
        == [1] * 3 + [2] * 3 + [3] * 3 + [4] * 3
    )
    assert (
        Variable("day", "integer", "", 1, 4, 1).scale(unit).tolist()
        == [1] * 3 + [2] * 3 + [3] * 3 + [4] * 3
    )


@pytest.mark.parametrize(
    ("low", "high", "step"), [(0.0, 0.6, 0.2), (-0.6, 0.6, 0.2), (0.0, 1.4, 0.2), (0.0, 11.0, 4.0)]
)
def test_all_values_of_a_range_can_be_tested_and_none_beyond_it(
    low: float, high: float, step: float
) -> None:
    variable = Variable("shift", "continuous", "m", low, high, step)
    assert [variable.encode(float(value)) for value in variable.grid] == variable.grid.tolist()
    last = np.full(2, variable.size - 1)
    assert variable.within(last, np.array([0.0, 1.0]))[1] == high
    assert (variable.categorise(variable.within(last, np.array([0.01, 1.0]))) == last).all()


def test_plain_data_round_trip() -> None:
    assert Space.from_dict(THESIS.to_dict()) == THESIS
    people = Space(
        (Variable("who", "categorical", values=("a", "b"), attributes=(("height_m", (1.2, 1.8)),)),)
    )
    assert Space.from_dict(people.to_dict()) == people
    sorts = Space((Variable("sort", "categorical", "class", values=("a", "b")),))
    assert Space.from_dict(sorts.to_dict()) == sorts
    assert people.to_dict()["who"]["attributes"] == {"height_m": [1.2, 1.8]}
    assert Space.from_dict(CUT.to_dict(), CUT.clauses) == CUT
    assert "weights" not in CUT.to_dict()["fog"] and CUT.to_dict()["fog"]["cuts"] == [20, 50]
    weighted = Space((Variable("x", "integer", "", 0, 2, 1, weights=(1, 5, 0)),))
    assert Space.from_dict(weighted.to_dict()).weights == weighted.weights == [(1, 5, 0)]


def test_cuts_divide_a_range_and_a_circle() -> None:
    fog, azimuth, _, speed = CUT.variables
    assert fog.labels == ("[0, 20)", "[20, 50)", "[50, 100]")
    assert fog.grid.tolist() == [10, 35, 75]
    assert fog.categorise(np.array([0, 19.9, 20, 50, 100])).tolist() == [0, 0, 1, 2, 2]
    assert fog.within(np.array([0, 2, 2]), np.array([0.5, 0.0, 0.5])).tolist() == [10, 50, 75]
    assert azimuth.labels == ("[45, 135)", "[135, 225)", "[225, 315)", "[315, 45)")
    assert azimuth.grid.tolist() == [90, 180, 270, 360]
    assert azimuth.within(np.array([3, 3]), np.array([0.25, 0.75])).tolist() == [337.5, 22.5]
    assert azimuth.categorise(np.array([0, 44, 45, 315, 360])).tolist() == [3, 3, 0, 3, 3]
    assert (fog.rounding, speed.rounding) == (1, 0.25)


def test_categories_have_distinct_names_at_any_magnitude() -> None:
    def labels(
        low: float, high: float, step: float = 0.0, cuts: tuple[float, ...] | None = None
    ) -> tuple[str, ...]:
        return Variable("x", "continuous", low=low, high=high, step=step, cuts=cuts).labels

    assert labels(1.7e9, 1700003600, cuts=(1700001200,)) == (
        "[1700000000, 1700001200)",
        "[1700001200, 1700003600]",
    )
    assert labels(-1e7, 1e7, cuts=(1234567.25,)) == (
        "[-10000000, 1234567.25)",
        "[1234567.25, 10000000]",
    )
    assert labels(0, 1e-9, cuts=(1e-10, 2e-10)) == (
        "[0, 1e-10)",
        "[1e-10, 2e-10)",
        "[2e-10, 1e-09]",
    )
    assert labels(0, 1, 1 / 3) == ("0", "0.333333", "0.666667", "1")
    assert labels(0, 0.6, 0.2) == ("0", "0.2", "0.4", "0.6")
    assert labels(1.7e9, 1700007200, 3600) == ("1700000000", "1700003600", "1700007200")
    close = labels(0, 1, cuts=(0.5, float(np.nextafter(0.5, 1))))
    assert len(set(close)) == 3


def test_samples_are_free_samples_that_keep_the_constraints() -> None:
    free, kept = (space.sample(200, np.random.default_rng(3)) for space in (SMALL, CONSTRAINED))
    allowed = CONSTRAINED.constraints.holds(SMALL.categorise(free))
    assert 0 < allowed.sum() < 200 and np.array_equal(free[allowed], kept[allowed])
    assert CONSTRAINED.violation(kept) is None


def test_an_almost_empty_space_is_refused() -> None:
    grains = tuple(Variable(name, "integer", "", 0, 1000, 1) for name in "abc")
    space = Space(grains, tuple((f"{name} = 7",) for name in "abc"))
    with pytest.raises(
        InputError,
        match="^constraints: they exclude almost the whole space: none of [0-9]+ random points "
        "satisfies them$",
    ):
        space.sample(1, np.random.default_rng(0))


def test_narrow_constraints_leave_independent_uniform_points() -> None:
    narrow = Space(THESIS.variables, (("blueprint = W 01",), ("animation = crouching",)))
    points = narrow.sample(3000, np.random.default_rng(0))
    assert narrow.violation(points) is None and len(np.unique(points, axis=0)) == 3000
    low = np.array([variable.low for variable in THESIS.variables[:6]])
    high = np.array([variable.high for variable in THESIS.variables[:6]])
    shares = (points[:, :6] - low) / (high - low)
    assert shares.mean(axis=0) == pytest.approx(np.full(6, 0.5), abs=0.03)
    assert shares.std(axis=0) == pytest.approx(np.full(6, 12**-0.5), abs=0.01)


def test_a_scenario_that_breaks_a_constraint_is_named_with_the_values_of_its_clause() -> None:
    right: dict[str, float | str] = {"x": 1.0, "angle": 0.0, "count": 1.0, "kind": "a"}
    assert CONSTRAINED.encode(right).tolist() == [1, 0, 1, 0]
    with pytest.raises(
        ValueError,
        match="^the scenario breaks the constraint 'kind != a or count = 1': count = 3, kind = a$",
    ):
        CONSTRAINED.encode(right | {"count": 3.0})
    points = np.array([[1, 0, 1, 0], [9.7, 0, 2, 1]])
    assert CONSTRAINED.violation(points) == (1, "breaks the constraint 'x != 10': x = 9.7")
    assert CONSTRAINED.violation(points[:1]) is None


def test_contradictory_constraints_are_refused_with_a_minimal_set_of_clauses() -> None:
    text = (
        "constraints: these contradict each other, so no point is left: [kind = a]; [count = "
        "2, kind != a]; [count != 2]"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        Space(
            SMALL.variables,
            (("x != 3",), ("kind = a",), ("count = 2", "kind != a"), ("count != 2",)),
        )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": 11.0}, r"x must be in \[0, 10\] m, got 11"),
        ({"x": float("nan")}, "x must be in"),
        ({"count": 2.5}, "count must be a whole number, got 2.5"),
        ({"kind": "z"}, "kind must be one of a, b, c; got 'z'"),
        ({"y": 1.0}, r"unknown \['y'\]"),
    ],
)
def test_a_wrong_scenario_is_named(change: dict[str, float | str], message: str) -> None:
    right: dict[str, float | str] = {"x": 1.0, "angle": 0.0, "count": 2.0, "kind": "a"}
    with pytest.raises(ValueError, match=message):
        SMALL.encode(right | change)


def test_a_wrong_variable_is_named() -> None:
    with pytest.raises(
        ValueError, match=r"variable 'sun': step must divide the circle of 360, got 100"
    ):
        Variable("sun", "continuous", "deg", 0, 360, 100, cyclic=True)
    with pytest.raises(ValueError, match="'v': low must be below high, got 1 to 0"):
        Variable("v", "continuous", "", 1, 0, 1)
    with pytest.raises(ValueError, match="'v': values must be distinct"):
        Variable("v", "categorical", values=("a", "a"))
    with pytest.raises(
        ValueError, match="'v': attribute 'height_m' must have 2 numbers, one a value, got 1"
    ):
        Variable("v", "categorical", values=("a", "b"), attributes=(("height_m", (1.2,)),))
    with pytest.raises(
        ValueError, match="'v': only the values of a categorical variable have attributes"
    ):
        Variable("v", "continuous", "", 0, 1, 1, attributes=(("height_m", (1.2,)),))
    with pytest.raises(ValueError, match=r"'v': cuts must rise inside \(0, 1\), got \[0.5, 0.2\]"):
        Variable("v", "continuous", "", 0, 1, cuts=(0.5, 0.2))
    with pytest.raises(ValueError, match="'v': cuts are for a continuous variable without a step"):
        Variable("v", "integer", "", 0, 9, cuts=(3,))
    with pytest.raises(
        ValueError, match=r"'v': a cyclic variable needs no cut or at least two, got \[3\]"
    ):
        Variable("v", "continuous", "", 0, 9, cyclic=True, cuts=(3,))
    with pytest.raises(ValueError, match="'v': weights must have 2 numbers, one a category, got 1"):
        Variable("v", "categorical", values=("a", "b"), weights=(1,))
    with pytest.raises(
        ValueError, match=r"'v': weights must be whole numbers from 0 to 1000, got \[1, -1\]"
    ):
        Variable("v", "categorical", values=("a", "b"), weights=(1, -1))
