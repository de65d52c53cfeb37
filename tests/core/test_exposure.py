"""Exposures: known shares, quantiles and density ratios, and wrong ones told by name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.config.exposure import FOLDER, read_exposure
from pipeline.core.exposure import Exposure
from pipeline.core.marginals import marginal
from pipeline.core.space import Space, Variable
from pipeline.core.sun import altitudes
from pipeline.errors import InputError
from pipeline.scenarios.people import variable as people
from tests.spaces import CONSTRAINED, SMALL, THESIS

X, COUNT, KIND = SMALL.variables[0], SMALL.variables[2], SMALL.variables[3]
PEOPLE = Variable(
    "who",
    "categorical",
    values=("child", "adult", "old"),
    attributes=(("height", (1.2, 1.8, 1.7)),),
)
MIXED: dict[str, Any] = {
    "variables": {"x": {"kind": "histogram", "edges": [0, 1, 10], "shares": [0.9, 0.1]}},
    "regimes": {
        "a": {
            "share": 0.25,
            "variables": {"kind": {"kind": "shares", "shares": {"a": 1, "b": 0, "c": 0}}},
        },
        "b": {"share": 0.75, "variables": {"x": {"kind": "uniform"}}},
    },
}


def draws(plain: dict[str, Any], space: Space = SMALL, count: int = 40_000) -> np.ndarray[Any, Any]:
    return Exposure.from_dict(space, plain).sample(count, np.random.default_rng(0))


def test_quantiles_of_a_histogram_are_even_inside_its_parts() -> None:
    histogram = marginal(X, {"kind": "histogram", "edges": [0, 1, 10], "shares": [0.9, 0.1]})
    assert histogram.quantile(np.array([0, 0.45, 0.9, 0.95])) == pytest.approx([0, 0.5, 1, 5.5])
    assert histogram.ratio(np.array([0.5, 5])) == pytest.approx([9, 0.1 / 9 * 10])


def test_a_part_without_share_is_never_drawn() -> None:
    histogram = marginal(X, {"kind": "histogram", "edges": [0, 1, 2, 3], "shares": [0, 1, 0]})
    assert histogram.quantile(np.array([0, np.nextafter(1, 0)])) == pytest.approx([1, 2])
    assert histogram.ratio(np.array([0.5, 1.5, 2.5, 7])) == pytest.approx([0, 10, 0, 0])


def test_an_integer_variable_has_whole_numbers() -> None:
    histogram = marginal(COUNT, {"kind": "histogram", "edges": [1, 3, 5], "shares": [0.4, 0.6]})
    values = histogram.quantile(np.linspace(0, 1, 30_000, endpoint=False))
    assert {value: round(float((values == value).mean()), 3) for value in range(1, 6)} == {
        1: 0.2,
        2: 0.2,
        3: 0.2,
        4: 0.2,
        5: 0.2,
    }


def test_both_ends_of_a_cyclic_integer_variable_are_one_value() -> None:
    hour = Variable("hour", "integer", low=0, high=4, step=1, cyclic=True)
    assert marginal(hour, {"kind": "uniform"}).shares == pytest.approx([0.25] * 4)
    histogram = marginal(hour, {"kind": "histogram", "edges": [0, 2, 4], "shares": [0.8, 0.2]})
    assert histogram.ratio(np.arange(5.0)) == pytest.approx([1.6, 1.6, 0.4, 0.4, 1.6])


def test_groups_share_their_part_evenly() -> None:
    groups = [
        {"where": {"height": [0, 1.5]}, "share": 0.1},
        {"where": {"height": [1.5, 3]}, "share": 0.9},
    ]
    assert marginal(PEOPLE, {"kind": "groups", "groups": groups}).shares == pytest.approx(
        [0.1, 0.45, 0.45]
    )


def test_a_range_of_a_group_ends_where_that_of_the_next_begins() -> None:
    groups = [
        {"where": {"height": [0, 1.7]}, "share": 0.1},
        {"where": {"height": [1.7, 3]}, "share": 0.9},
    ]
    assert marginal(PEOPLE, {"kind": "groups", "groups": groups}).shares == pytest.approx(
        [0.1, 0.45, 0.45]
    )


def test_a_regime_replaces_what_is_common() -> None:
    points = draws(MIXED)
    only_a = points[:, 3] == 0
    assert only_a.mean() == pytest.approx(0.25 + 0.75 / 3, abs=0.01)
    assert (points[~only_a, 0] < 1).mean() == pytest.approx(0.1, abs=0.01)


def test_the_mean_ratio_of_uniform_points_is_one_and_weights_give_the_exposures_means() -> None:
    exposure = Exposure.from_dict(SMALL, MIXED)
    points = SMALL.sample(200_000, np.random.default_rng(1))
    weights = exposure.ratio(points)
    assert weights.mean() == pytest.approx(1, abs=0.02)
    assert weights.max() <= exposure.largest_ratio * (1 + 1e-9)
    assert np.average(points[:, 0], weights=weights) == pytest.approx(
        draws(MIXED)[:, 0].mean(), rel=0.03
    )


def test_points_keep_the_constraints_and_the_ratio_is_known_up_to_a_factor() -> None:
    exposure = Exposure.from_dict(CONSTRAINED, MIXED)
    drawn = exposure.sample(5000, np.random.default_rng(0))
    assert CONSTRAINED.violation(drawn) is None
    even = CONSTRAINED.sample(200_000, np.random.default_rng(1))
    assert np.average(even[:, 0], weights=exposure.ratio(even)) == pytest.approx(
        drawn[:, 0].mean(), rel=0.03
    )


def test_an_exposure_that_the_constraints_exclude_is_refused(tmp_path: Path) -> None:
    text = (
        "description: d\nvariables: {kind: {kind: shares, shares: {a: 1, b: 0, c: 0}, source: "
        "none is known}}"
    )
    (tmp_path / "mine.yaml").write_text(text)
    read, space = (
        read_exposure(str(tmp_path / "mine.yaml")),
        Space(SMALL.variables, (("kind != a",),)),
    )
    with pytest.raises(
        InputError, match="exposure for F1: the constraints exclude almost all of the exposure"
    ):
        read.of("F1", space)
    with pytest.raises(ValueError, match="the constraints exclude almost all of the exposure"):
        Exposure.from_dict(space, read.plain).check()
    assert read.of("F1", SMALL).space is SMALL


def test_an_exposure_that_the_constraints_nearly_exclude_is_drawn_or_refused_by_name() -> None:
    narrow = Space(SMALL.variables, (("x = 3",), ("angle = 30",), ("count = 2",), ("kind = a",)))
    assert (
        narrow.violation(Exposure.from_dict(narrow, MIXED).sample(500, np.random.default_rng(0)))
        is None
    )
    never = Exposure.from_dict(
        narrow, {"variables": {"kind": {"kind": "shares", "shares": {"a": 0, "b": 1, "c": 0}}}}
    )
    with pytest.raises(InputError, match="^constraints: they exclude almost all of the exposure: "):
        never.sample(1, np.random.default_rng(0))


def test_every_number_of_an_exposure_says_where_it_comes_from() -> None:
    for path in FOLDER.glob("*.yaml"):
        read = read_exposure(path.stem)
        bodies = [
            *read.variables.values(),
            *(body for regime in read.regimes.values() for body in regime.variables.values()),
        ]
        sources = [body["source"] for body in bodies] + [
            regime.source for regime in read.regimes.values()
        ]
        for source in [*sources, *([read.scenarios.source] if read.scenarios else [])]:
            assert re.search("measured|derived|assumed", source, re.IGNORECASE), f"{path}: {source}"


def test_the_sun_stands_as_high_as_the_latitude_lets_it() -> None:
    heights, shares = altitudes(50, [1] * 24)
    assert heights.max() == pytest.approx(90 - 50 + 23.44, abs=0.2)
    assert shares[heights > 0].sum() == pytest.approx(0.5, abs=0.01)
    noon, _ = altitudes(0, [0] * 12 + [1] + [0] * 11)
    assert noon.max() == pytest.approx(90, abs=1)


def test_a_deep_night_counts_as_the_lowest_altitude() -> None:
    sun = marginal(
        THESIS.variables[3], {"kind": "sun", "latitude_deg": 50, "hours": [1] + [0] * 23}
    )
    assert sun.quantile(np.array([0.0, 0.3]))[1] < -19


@pytest.mark.parametrize(
    ("variable", "plain", "problem"),
    [
        (X, {"kind": "histgram"}, "x: there is no kind 'histgram'; did you mean 'histogram'?"),
        (
            X,
            {"kind": "histogram", "edges": [0, 1], "shares": [0.9]},
            "shares must be from 0 and sum to 1, got [0.9], which sum to 0.9",
        ),
        (
            X,
            {"kind": "histogram", "edges": [0, 11], "shares": [1]},
            "edges must rise within [0, 10], one more than shares (1), got [0.0, 11.0]",
        ),
        (
            X,
            {"kind": "histogram", "edges": [0, float("nan")], "shares": [1]},
            "edges must rise within [0, 10]",
        ),
        (
            PEOPLE,
            {"kind": "groups", "groups": [{"where": None, "share": 1}]},
            "where must be ranges of attributes by name, got None",
        ),
        (
            X,
            {"kind": "histogram", "shares": [1]},
            "x: missing 1 required positional argument: 'edges'",
        ),
        (X, {"kind": "normal", "mean": 1, "deviation": 0}, "deviation must be above 0, got 0"),
        (
            X,
            {"kind": "shares", "shares": {}},
            "kind 'shares' is for a variable that is categorical, this one is continuous",
        ),
        (
            KIND,
            {"kind": "shares", "shares": {"a": 1, "d": 0}},
            "shares must name every category; missing ['b', 'c'], unknown ['d']",
        ),
        (
            PEOPLE,
            {"kind": "groups", "groups": [{"where": {"heigt": [0, 2]}, "share": 1}]},
            "no attribute 'heigt'; did you mean 'height'?",
        ),
        (PEOPLE, {"kind": "groups", "groups": [{"share": 1}]}, "key 'where' is missing"),
        (
            PEOPLE,
            {"kind": "groups", "groups": [{"where": {"height": [1.5, 2]}, "share": 1}]},
            "in one group, but child is in 0",
        ),
        (
            X,
            {"kind": "sun", "latitude_deg": 50, "hours": [1]},
            "hours must be 24 numbers from 0, not all 0, got [1]",
        ),
    ],
)
def test_wrong_distributions_are_told_by_name(
    variable: Variable, plain: dict[str, Any], problem: str
) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011
        marginal(variable, plain)
    assert problem in str(error.value)


def test_an_unknown_variable_and_wrong_regimes_are_told() -> None:
    with pytest.raises(ValueError, match="the space has no variable 'y'"):
        Exposure.from_dict(SMALL, {"variables": {"y": {"kind": "uniform"}}})
    with pytest.raises(
        ValueError, match="regimes: shares must be above 0 and sum to 1, got \\[0.5\\]"
    ):
        Exposure.from_dict(SMALL, {"regimes": {"a": {"share": 0.5, "variables": {}}}})


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{description: d, regime: {}}", "unknown key 'regime'; did you mean 'regimes'?"),
        (
            "{description: d, variables: {fog: {kind: uniform}}}",
            "variables.fog: needs 'source', the public source",
        ),
        ("{description: 3}", "description: expected text, got 3"),
        ("[]", "expected keys with values, got []"),
    ],
)
def test_a_wrong_file_is_told_by_its_key(text: str, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"{re.escape(str(path))}: .*{re.escape(problem)}"):
        read_exposure(str(path))


@pytest.mark.parametrize("name", sorted(path.stem for path in FOLDER.glob("*.yaml")))
def test_every_exposure_fits_the_scenarios_space(name: str) -> None:
    for population in (1, 2):
        space = Space.from_dict(
            {
                **{v.name: v.to_dict() for v in THESIS.variables[:-1]},
                "blueprint": people(population),
            }
        )
        points = Exposure.from_dict(space, read_exposure(name).plain).sample(
            500, np.random.default_rng(0)
        )
        assert all(space.encode(space.decode(point)) == pytest.approx(point) for point in points)
