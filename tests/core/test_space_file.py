"""Operating conditions: intervals, cyclic ones, spellings; wrong files are rejected by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from pipeline.artefacts.point_table import read_points
from pipeline.artefacts.space_file import read_space_file
from pipeline.artefacts.table_categories import Meanings
from pipeline.core.coverage.mixed import Combination, NamedPlanes
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError

GOOD = """
variables:
  weather: {values: [sunny, cloudy, rainy], weights: {rainy: 3}}
  fog: {interval: [0, 100], cuts: [20, 50, 80], unit: "%"}
  azimuth: {interval: [0, 360], cuts: [45, 135, 225, 315], cyclic: true}
  lanes: {values: [1, 2]}
  current_lane: {values: [1, 2]}
  night: {values: [false, true]}
constraints:
  - [lanes = 2, current_lane != 2]
"""


def space_of(tmp_path: Path, text: str = GOOD) -> Space:
    path = tmp_path / "space.yaml"
    path.write_text(text)
    return read_space_file(path)


def of(variable: Variable, values: list[Any]) -> list[int]:
    return list(Meanings(variable).categories(pa.chunked_array([values])))


def test_a_space_file_gives_its_variables_and_constraints(tmp_path: Path) -> None:
    space = space_of(tmp_path)
    assert space.sizes == (3, 4, 4, 2, 2, 2)
    assert space.variables[0].weights == (1, 1, 3) and space.variables[5].labels == (
        "false",
        "true",
    )
    assert space.variables[1].labels == ("[0, 20)", "[20, 50)", "[50, 80)", "[80, 100]")
    assert space.variables[2].labels == ("[45, 135)", "[135, 225)", "[225, 315)", "[315, 45)")
    assert space.constraints.feasible_cells([3, 4]).tolist() == [[True, False], [True, True]]


def test_values_fall_into_their_intervals() -> None:
    fog = Variable("fog", "continuous", low=0, high=100, cuts=(20, 50, 80))
    assert of(fog, ["0", "19.99", "20", "79", " 80", "100.0", "[20, 50)"]) == [0, 0, 1, 2, 3, 3, 1]
    assert of(fog, [0, 19.99, 20, 79, 80, 100.0]) == [0, 0, 1, 2, 3, 3]
    azimuth = Variable(
        "azimuth", "continuous", low=0, high=360, cuts=(45, 135, 225, 315), cyclic=True
    )
    assert of(azimuth, [0, 44, 45, 314, 315, 360]) == [3, 3, 0, 2, 3, 3]
    assert of(Variable("x", "continuous", low=0, high=1, cuts=()), [0, 0.5, 1]) == [0, 0, 0]


def test_values_of_a_grid_belong_to_the_nearest_category() -> None:
    speed = Variable("speed", "continuous", "m/s", 0, 3, 0.5)
    assert of(speed, [0.0, 0.2, 0.3, 2.9]) == [0, 0, 1, 6]
    assert of(speed, ["0.2", "1.5"]) == [0, 3]


def test_tables_may_spell_numbers_and_truth_values_differently() -> None:
    lanes, night = (
        Variable("lanes", "categorical", values=("1", "2")),
        Variable("night", "categorical", values=("false", "true")),
    )
    assert of(lanes, ["1", "2", "2.0", " 1", "+1.0"]) == [0, 1, 1, 0, 0]
    assert of(lanes, [1, 2]) == of(lanes, [1.0, 2.0]) == [0, 1]
    assert of(night, ["TRUE", "False", "true"]) == [1, 0, 1]
    assert of(night, [True, False]) == [1, 0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("weather: {values", "weather: {vaules"),
            "unknown key 'variables.weather.vaules'; did you mean 'values'?",
        ),
        (
            ("cuts: [20, 50, 80]", "cuts: [20, 50, 50]"),
            "variables.fog.cuts: expected rising numbers inside [0, 100]",
        ),
        (
            ("cuts: [20, 50, 80]", "cuts: [20, .nan]"),
            "variables.fog.cuts: expected a list of numbers",
        ),
        (
            ("interval: [0, 100]", "interval: [100, 0]"),
            "variables.fog.interval: expected two numbers, the smaller first",
        ),
        (
            ("cuts: [45, 135, 225, 315]", "cuts: [45]"),
            "a cyclic interval needs no cut or at least two",
        ),
        (
            ("{rainy: 3}", "{rany: 3}"),
            "variables.weather.weights: there is no category 'rany'; did you mean 'rainy'?",
        ),
        (
            ("{rainy: 3}", "{rainy: -1}"),
            "variables.weather.weights.rainy: expected a whole number from 0 to 1000, got -1",
        ),
        (
            ("{rainy: 3}", "[1, 2]"),
            "variables.weather.weights: expected 3 numbers, one a category, got 2",
        ),
        (("[1, 2]}\n  current", "[1, 1]}\n  current"), "variables.lanes.values: '1' appears twice"),
        (
            ("lanes = 2,", "lane = 2,"),
            "constraint 'lane = 2': variable must be one of weather, fog",
        ),
        (("current_lane != 2", "current_lane != 3"), "category must be one of 1, 2; got '3'"),
        (("variables:", "variabels:"), "expected a mapping with 'variables'"),
        (("constraints:", "constraint:"), "unknown key 'constraint'; did you mean 'constraints'?"),
        (
            ("  - [lanes = 2, current_lane != 2]", "  lanes = 2"),
            "constraints: expected a list, each a text such as",
        ),
        (
            ("lanes: {values: [1, 2]}", "lanes: [1, 2]"),
            "variables.lanes: expected values or an interval",
        ),
        (
            ("lanes: {values: [1, 2]}", "lanes: {values: [1, 2], cyclic: true}"),
            "cuts and cyclic go with an interval",
        ),
        (("variables:", "variables: ["), "not valid YAML"),
        (
            ("  fog: {", "  weather: {"),
            "space.yaml, line 4: not valid YAML (the key 'weather' appears twice)",
        ),
        (
            ("cuts: [20, 50, 80]", "cuts: [20], cuts: [50]"),
            "line 4: not valid YAML (the key 'cuts' appears twice)",
        ),
        (
            ("cyclic: true", 'cyclic: "no"'),
            "variables.azimuth.cyclic: expected true or false, got no",
        ),
        (
            ("[false, true]", "[false, null]"),
            "variables.night.values: expected names, got null; put a name in quotes",
        ),
        (
            ("[false, true]", "[false, ~]"),
            "variables.night.values: expected names, got null; put a name in quotes",
        ),
        (
            ("[false, true]", "[false, [true]]"),
            "variables.night.values: expected names, got [true]; put a name in quotes",
        ),
        (
            ("  night:", "  null:"),
            "space.yaml, line 8: not valid YAML (expected text as a key, got 'null')",
        ),
        (("lanes: {values: [1, 2]}", "lanes:"), "variables.lanes: expected values or an interval"),
        (
            ("[lanes = 2,", "[{lanes: 2},"),
            "constraints: expected texts such as lanes = 2, got {'lanes': '2'}; put the text in "
            "quotes",
        ),
        (
            ("interval: [0, 100]", "interval: [0, 1_00]"),
            "variables.fog.interval: expected a list of numbers, got [0, 1_00]",
        ),
        (
            ("cuts: [20, 50, 80]", "cuts: [12:30]"),
            "variables.fog.cuts: expected a list of numbers, got [12:30]",
        ),
        (
            ("{rainy: 3}", "{rainy: 3.0}"),
            "variables.weather.weights.rainy: expected a whole number from 0 to 1000, got 3.0",
        ),
        (
            ("{rainy: 3}", "{rainy: yes}"),
            "variables.weather.weights.rainy: expected a whole number from 0 to 1000, got yes",
        ),
        ((GOOD, "[" * 5_000), "nested too deeply"),
        (
            (GOOD, "variables: {x: {values: !!python/name:os.system a}}"),
            "could not determine a constructor",
        ),
        ((GOOD, "\0"), "not valid YAML"),
        (
            ("weather: {values: [sunny, cloudy, rainy],", "weather: {values: &all [*all],"),
            "line 3: not valid YAML (the alias *all is",
        ),
    ],
)
def test_a_wrong_space_file_is_named(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        space_of(tmp_path, GOOD.replace(*change, 1))
    assert message in str(caught.value) and "space.yaml" in str(caught.value)


PLANES = """
planes:
  sight: {conditions: [fog, weather, night], strength: 2}
  road: {conditions: [lanes, current_lane]}
combinations:
  - {of: {night: true, weather: rainy}, weight: 5}
  - {of: {fog: "[80, 100]"}}
"""


def test_a_space_file_names_planes_and_weighs_combinations(tmp_path: Path) -> None:
    extras = space_of(tmp_path, GOOD + PLANES).extras
    assert extras.planes == (NamedPlanes("sight", (0, 1, 5), 2), NamedPlanes("road", (3, 4), 2))
    assert extras.combinations == (Combination((0, 5), (2, 1), 5), Combination((1,), (3,), 1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("planes:\n", "planes: [sight]\nx:\n"),
            "unknown key 'x'; known are combinations, constraints, frames,",
        ),
        (
            ("sight: {conditions", "sight: {condition"),
            "unknown key 'planes.sight.condition'; did you mean 'conditions'?",
        ),
        (
            ("sight: {conditions: [fog, weather, night], strength: 2}", "sight: [fog, night]"),
            "planes.sight: expected an entry such as "
            "{conditions: [weather, light, road], strength: 3}, got [fog, night]",
        ),
        (
            ("[fog, weather, night]", "[fogg, weather]"),
            "planes.sight.conditions: there is no condition fogg; did you mean 'fog'?",
        ),
        (
            ("[fog, weather, night]", "[fog, night, fog]"),
            "planes.sight.conditions: 'fog' appears twice",
        ),
        (
            ("[fog, weather, night]", "fog"),
            "planes.sight.conditions: expected a list of conditions, got fog",
        ),
        (
            ("strength: 2", "strength: 4"),
            "planes.sight.strength: expected a whole number from 1 to 3, got 4",
        ),
        (
            ("strength: 2", "strength: two"),
            "planes.sight.strength: expected a whole number from 1 to 3, got two",
        ),
        (("  road:", "  null:"), "not valid YAML (expected text as a key, got 'null')"),
        (
            ("weather: rainy}", "weather: rany}"),
            "combinations[1].of.weather: there is no category rany; did you mean 'rainy'?",
        ),
        (
            ("{of: {night", "{of: {nigth"),
            "combinations[1].of: there is no condition nigth; did you mean 'night'?",
        ),
        (
            ("weight: 5", "weight: 1001"),
            "combinations[1].weight: expected a whole number from 0 to 1000, got 1001",
        ),
        (("weight: 5", "weigh: 5"), "unknown key 'combinations[1].weigh'; did you mean 'weight'?"),
        (
            ('{of: {fog: "[80, 100]"}}', "{of: {}}"),
            "combinations[2].of: expected a category for each of 1 to 6 conditions, got {}",
        ),
        (
            ('{of: {fog: "[80, 100]"}}', "rainy"),
            "combinations[2]: expected an entry such as {of: {weather: rainy, light: night},",
        ),
        (
            ('{of: {fog: "[80, 100]"}}', "{of: {weather: rainy, night: true}}"),
            "combinations[2]: {'night': 'true', 'weather': 'rainy'} appears twice",
        ),
        (
            ('{of: {fog: "[80, 100]"}}', "{of: {lanes: 1, current_lane: 2}}"),
            "combinations: the constraints leave no point with lanes = 1, current_lane = 2",
        ),
    ],
)
def test_wrong_planes_and_combinations_are_named(
    change: tuple[str, str], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        space_of(tmp_path, GOOD + PLANES.replace(*change, 1))
    assert message in str(caught.value) and "space.yaml" in str(caught.value)


def test_bytes_that_are_not_text_and_a_missing_file_are_named(tmp_path: Path) -> None:
    (tmp_path / "space.yaml").write_bytes(GOOD.encode() + b"\xff")
    with pytest.raises(
        InputError, match=r"space.yaml: expected UTF-8 text, got the byte 0xff at \d+"
    ):
        read_space_file(tmp_path / "space.yaml")
    with pytest.raises(InputError, match="nowhere.yaml: expected a YAML file, got no such file"):
        read_space_file(tmp_path / "nowhere.yaml")


def test_contradictory_constraints_are_named_with_a_minimal_core(tmp_path: Path) -> None:
    more = (
        GOOD + "  - [weather = sunny, night = true]\n  - [lanes = 1]\n  - [current_lane = 2]\n  - "
        "[fog != '[0, 20)']\n"
    )
    with pytest.raises(InputError) as caught:
        space_of(tmp_path, more.replace("fog != '[0, 20)'", "night = true"))
    assert "[lanes = 2, current_lane != 2]; [lanes = 1]; [current_lane = 2]" in str(caught.value)
    assert "sunny" not in str(caught.value)


def test_a_condition_of_many_values_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match="expected at most 5,000 names, got 5,001; a measurement needs an interval with cuts",
    ):
        space_of(tmp_path, f"variables: {{x: {{values: {list(range(5_001))}}}}}")


HEAD = "weather,fog,azimuth,lanes,current_lane,night\n"
ROW = "sunny,3,350,1,1,true\n"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            HEAD + ROW + "suny,3,350,1,1,true\n",
            "row 2: weather must be one of sunny, cloudy, rainy (did you mean 'sunny'?), got "
            "'suny'",
        ),
        (
            HEAD + ROW + "sunny,,350,1,1,true\n",
            "row 2: fog must be a number in [0, 100] %, got nothing",
        ),
        (HEAD + "sunny,nan,350,1,1,true\n", "row 1: fog must be a number in [0, 100] %, got 'nan'"),
        (HEAD + "sunny,101,350,1,1,true\n", "row 1: fog must be a number in [0, 100] %, got 101"),
        (
            HEAD + ",3,350,1,1,true\n",
            "row 1: weather must be one of sunny, cloudy, rainy, got nothing",
        ),
        (
            HEAD + ROW + ROW + "sunny,3,350,1,2,true\n",
            "row 3 breaks the constraint 'lanes = 2 or current_lane != 2': weather = sunny,",
        ),
        (
            "weather,fog\nsunny,3\n",
            "expected a column for each condition; there is none for azimuth, lanes, current_lane, "
            "night",
        ),
        (HEAD, "expected points, got an empty table"),
        ("", "expected points, got an empty table"),
    ],
)
def test_a_wrong_table_is_named(table: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(table)
    with pytest.raises(InputError) as caught:
        read_points(path, space_of(tmp_path)).strict()
    assert message in str(caught.value)


def test_a_column_of_many_different_values_is_explained() -> None:
    column = pa.chunked_array([[f"frame {i}" for i in range(100_000)]])
    weather = Meanings(Variable("weather", "categorical", values=("sunny", "rainy")))
    weather.categories(column)
    faults = weather.faults()
    assert (
        len(faults) == 1
        and "100,000 different values, as an identifier or a measurement has" in faults[0].text
    )


def test_an_interval_may_have_no_end(tmp_path: Path) -> None:
    speed = space_of(
        tmp_path, "variables: {speed: {interval: [-.inf, .inf], cuts: [0, 50]}}"
    ).variables[0]
    assert speed.labels == ("[-inf, 0)", "[0, 50)", "[50, inf]") and of(
        speed, ["-1e9", "50", "nan", "[50, inf]"]
    ) == [0, 2, -1, 2]
    for wrong, message in (
        ("interval: [0, .nan]", "expected a list of numbers"),
        ("interval: [0, .inf], cyclic: true", "two finite ends"),
    ):
        with pytest.raises(InputError, match=message):
            space_of(tmp_path, f"variables: {{speed: {{{wrong}}}}}")
