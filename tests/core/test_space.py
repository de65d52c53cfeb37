"""The encoding of scenario spaces."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.space import Space, Variable
from tests.spaces import SMALL, THESIS


def test_sizes_of_the_thesis_space() -> None:
    assert THESIS.sizes == (11, 11, 12, 12, 11, 13, 6, 74)


def test_values_belong_to_the_nearest_category_and_cyclic_ones_close_the_circle() -> None:
    azimuth, rain = THESIS.variables[2], THESIS.variables[0]
    assert azimuth.categorise(np.array([0.0, 14, 16, 344, 346, 360])).tolist() == [0, 0, 1, 11, 0, 0]
    assert rain.categorise(np.array([0.0, 4, 6, 94, 96, 100])).tolist() == [0, 0, 1, 9, 10, 10]


@pytest.mark.parametrize(("low", "high", "step"), [(0.0, 0.6, 0.2), (-0.6, 0.6, 0.2), (0.0, 1.4, 0.2), (0.0, 11.0, 4.0)])
def test_all_values_of_a_range_can_be_tested_and_none_beyond_it(low: float, high: float, step: float) -> None:
    variable = Variable("shift", "continuous", "m", low, high, step)
    assert [variable.encode(float(value)) for value in variable.grid] == variable.grid.tolist()
    last = np.full(2, variable.size - 1)
    assert variable.within(last, np.array([0.0, 1.0]))[1] == high
    assert (variable.categorise(variable.within(last, np.array([0.01, 1.0]))) == last).all()


def test_plain_data_round_trip() -> None:
    assert Space.from_dict(THESIS.to_dict()) == THESIS
    people = Space((Variable("who", "categorical", values=("a", "b"), attributes=(("height_m", (1.2, 1.8)),)),))
    assert Space.from_dict(people.to_dict()) == people
    assert people.to_dict()["who"]["attributes"] == {"height_m": [1.2, 1.8]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": 11.0}, r"x must be in \[0, 10\] m, got 11"),
        ({"x": float("nan")}, "x must be in"),
        ({"kind": "z"}, "kind must be one of a, b, c; got 'z'"),
        ({"y": 1.0}, r"unknown \['y'\]"),
    ],
)
def test_a_wrong_scenario_is_named(change: dict[str, float | str], message: str) -> None:
    right: dict[str, float | str] = {"x": 1.0, "angle": 0.0, "count": 2.0, "kind": "a"}
    with pytest.raises(ValueError, match=message):
        SMALL.encode(right | change)


def test_a_wrong_variable_is_named() -> None:
    with pytest.raises(ValueError, match=r"variable 'sun': step must divide the circle of 360, got 100"):
        Variable("sun", "continuous", "deg", 0, 360, 100, cyclic=True)
    with pytest.raises(ValueError, match="'v': low must be below high, got 1 to 0"):
        Variable("v", "continuous", "", 1, 0, 1)
    with pytest.raises(ValueError, match="'v': values must be distinct"):
        Variable("v", "categorical", values=("a", "a"))
    with pytest.raises(ValueError, match="'v': attribute 'height_m' must have 2 numbers, one a value, got 1"):
        Variable("v", "categorical", values=("a", "b"), attributes=(("height_m", (1.2,)),))
    with pytest.raises(ValueError, match="'v': only the values of a categorical variable have attributes"):
        Variable("v", "continuous", "", 0, 1, 1, attributes=(("height_m", (1.2,)),))
