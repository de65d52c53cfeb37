"""OpenODD files as spaces.

The example of the how-to by hand, random modules against three-valued logic, and what is refused by
place.
"""

from __future__ import annotations

import json
import random
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pipeline.artefacts.model_export import write_model
from pipeline.artefacts.odd_conditions import categories_meant
from pipeline.artefacts.odd_numbers import bounds, converted
from pipeline.artefacts.odd_taxonomy import Concept
from pipeline.artefacts.space_formats import read_space_of_any_format
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError

EXAMPLE = Path(__file__).parents[2] / "docs/howto/standard-odds/odd.yaml"


def read(folder: Path, plain: Any) -> Space:
    # By way of JSON, because a part that occurs twice would become an alias, which no reader takes.
    text = (
        plain
        if isinstance(plain, str)
        else yaml.safe_dump(json.loads(json.dumps(plain)), sort_keys=False)
    )
    (folder / "odd.yaml").write_text(text)
    return read_space_of_any_format(folder / "odd.yaml")


def test_the_example_is_the_space_that_its_statements_mean() -> None:
    space = read_space_of_any_format(EXAMPLE)
    labels = {variable.name: variable.labels for variable in space.variables}
    assert labels["rainfall_intensity"] == ("no_rain", "light_rain", "moderate_rain", "heavy_rain")
    assert labels["intersection"] == ("t_junction", "y_junction", "cross_road", "not_applicable")
    assert (
        labels["subject_vehicle_speed"] == ("[0, 30)", "[30, 50)", "[50, inf]")
        and space.variables[-1].unit == "km/h"
    )
    assert set(space.clauses) == {
        ("intersection = not_applicable", "intersection_classification != not_applicable"),
        ("intersection != not_applicable", "intersection_classification = not_applicable"),
        ("rainfall_intensity != no_rain", "rainfall_type = not_applicable"),
        ("rainfall_intensity = no_rain", "rainfall_type != not_applicable"),
        ("drivable_area_type = distributor_road", "drivable_area_type = minor_road"),
        ("subject_vehicle_speed != [50, inf]",),
        (
            "drivable_area_included_surface_condition = dry",
            "drivable_area_included_surface_condition = wet",
        ),
        ("rainfall_intensity != heavy_rain",),
        ("special_structures_type != tunnel",),
        ("drivable_area_included_surface_condition != wet", "subject_vehicle_speed = [0, 30)"),
        ("natural_illuminance != night", "artificial_illuminance != none"),
    }


def test_the_example_survives_as_a_space_file(tmp_path: Path) -> None:
    space = read_space_of_any_format(EXAMPLE)
    write_model(tmp_path / "space.yaml", space, "space")
    back = read_space_of_any_format(tmp_path / "space.yaml")
    assert [(v.name, v.labels, v.unit) for v in back.variables] == [
        (v.name, v.labels, v.unit) for v in space.variables
    ]
    assert back.clauses == space.clauses


TAXONOMY: dict[str, Any] = {
    "scenery": {
        "road": ["city", "rural", "motorway"],
        "roundabout": {"size": ["mini", "large"], "signals": "boolean"},
        "lanes": "integer count",
    },
    "weather": {
        "rain_rate": "float precipitation_rate",
        "rain": {
            "dry": {"rain_rate": "< 0.1 mm/h"},
            "light": {"rain_rate": "[0.1 .. 2.5] mm/h"},
            "heavy": {"rain_rate": "> 2.5 mm/h"},
        },
        "wind_speed": "float velocity",
    },
}
CONDITIONS: list[tuple[str, Any, Any]] = [
    ("road", "city", lambda p: p["road"] == "city"),
    ("scenery.road", ["rural", "motorway"], lambda p: p["road"] in ("rural", "motorway")),
    ("size", "mini", lambda p: None if p["size"] == "not_applicable" else p["size"] == "mini"),
    (
        "signals",
        "true",
        lambda p: None if p["signals"] == "not_applicable" else p["signals"] == "true",
    ),
    ("lanes", "<= 2", lambda p: p["lanes"] <= 2),
    ("lanes", "> 3", lambda p: p["lanes"] > 3),
    ("lanes", "[2 .. 3]", lambda p: 2 <= p["lanes"] <= 3),
    ("rain", ">= light", lambda p: p["rain"] != "dry"),
    ("rain", "< heavy", lambda p: p["rain"] != "heavy"),
    ("rain", "<heavy", lambda p: p["rain"] != "heavy"),
    ("rain", ">=light", lambda p: p["rain"] != "dry"),
    ("rain_rate", "> 0.1 mm/h", lambda p: p["rain"] != "dry"),
    ("rain_rate", "[0.1 .. 2.5] mm/h", lambda p: p["rain"] == "light"),
    ("wind_speed", "< 36 km/h", lambda p: p["wind_speed"] < 10),
    ("wind_speed", ">= 20 m/s", lambda p: p["wind_speed"] > 20),
]
VALUES: dict[str, list[Any]] = {
    "road": ["city", "rural", "motorway"],
    "size": ["mini", "large", "not_applicable"],
    "signals": ["true", "false", "not_applicable"],
    "lanes": [1, 2, 3, 4, 7],
    "rain": ["dry", "light", "heavy"],
    "wind_speed": [3, 15, 28],
}


def kleene(operator: str, parts: list[bool | None]) -> bool | None:
    strong = operator == "OR"
    return strong if strong in parts else None if None in parts else not strong


class RandomModules:
    """Modules, and whether each holds at a point.

    None where that is unknown because a concept does not apply.
    """

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.plain: dict[str, Any] = {}
        self.holds: dict[str, Any] = {}
        for index in range(3):
            self._add(f"m{index}", labels=["any"] if index < 2 else [])
        self._add("top", labels=[])

    def _add(self, name: str, labels: list[str]) -> None:
        module: dict[str, Any] = {"LABELS": labels} if labels else {}
        tests = []
        for kind in self.rng.sample(["INCLUDE", "EXCLUDE"], self.rng.randint(1, 2)):
            operator = self.rng.choice(["AND", "OR"])
            module[f"{kind}_{operator}"], test = self._section(operator, name == "top")
            tests.append((kind, test))
        self.plain[name] = module

        def holds(point: dict[str, Any]) -> bool | None:
            parts = [
                test(point)
                if kind == "INCLUDE"
                else (None if (got := test(point)) is None else not got)
                for kind, test in tests
            ]
            return kleene("AND", parts)

        self.holds[name] = holds

    def _section(
        self, operator: str, top: bool, nested: bool = False
    ) -> tuple[dict[str, Any], Any]:
        chosen = {
            key: (plain, test)
            for key, plain, test in self.rng.sample(CONDITIONS, self.rng.randint(1, 3))
        }
        section = {key: plain for key, (plain, _) in chosen.items()}
        tests = [test for _, test in chosen.values()]
        if top and not nested:
            for key, several in (("m2", ["m2"]), ("any", ["m0", "m1"])):
                wanted = self.rng.choice([True, False])
                section[key] = wanted
                tests.append(self._reference(several, wanted))
        if not nested and self.rng.random() < 0.5:
            other = "OR" if operator == "AND" else "AND"
            section[other], test = self._section(other, top, nested=True)
            tests.append(test)
        return section, lambda point: kleene(operator, [test(point) for test in tests])

    def _reference(self, several: list[str], wanted: bool) -> Any:
        def test(point: dict[str, Any]) -> bool | None:
            result = kleene("OR", [self.holds[name](point) for name in several])
            return result if result is None else result is wanted

        return test


@pytest.mark.parametrize("seed", range(80))
def test_random_modules_allow_what_three_valued_logic_allows(seed: int, tmp_path: Path) -> None:
    modules = RandomModules(random.Random(seed))
    coverage = {
        "OPTIONAL": ["roundabout"],
        "CUTS": {"lanes": ["2", "3", "4"], "wind_speed": ["10 m/s", "72 km/h"]},
    }
    plain = {
        "TAXONOMY": TAXONOMY,
        "ODD": {"top": modules.plain.pop("top")},
        "MODULES": modules.plain,
        "COVERAGE": coverage,
    }
    points = [dict(zip(VALUES, values, strict=True)) for values in product(*VALUES.values())]
    points = [
        point
        for point in points
        if (point["size"] == "not_applicable") == (point["signals"] == "not_applicable")
    ]
    expected = {
        tuple(map(str, point.values()))
        for point in points
        if modules.holds["top"](point) is not False
    }
    if not expected:
        with pytest.raises(InputError, match="no combination satisfies it|contradict"):
            read(tmp_path, plain)
        return
    space = read(tmp_path, plain)
    assert space.names == ("road", "size", "signals", "lanes", "rain", "wind_speed")
    rows = np.array(list(product(*map(range, space.sizes))))
    feasible = {tuple(row) for row in rows[space.constraints.holds(rows)].tolist()}
    result = set()
    for point in points:
        row = [
            variable.labels.index(str(value))
            if variable.kind == "categorical"
            else int(variable.categorise(np.array([float(value)]))[0])
            for variable, value in zip(space.variables, point.values(), strict=True)
        ]
        if tuple(row) in feasible:
            result.add(tuple(map(str, point.values())))
    assert result == expected


def test_records_inside_optional_records_are_absent_with_them(tmp_path: Path) -> None:
    taxonomy = {
        "junction": {"kind": ["t", "x"], "lights": {"colour": ["red", "green"], "arrow": "boolean"}}
    }
    space = read(tmp_path, {"TAXONOMY": taxonomy, "COVERAGE": {"OPTIONAL": ["junction", "lights"]}})
    cells = space.constraints.feasible_cells([0, 1, 2])
    # Without a junction no light; with one, all lights' attributes or none of them.
    assert [tuple(cell) for cell in np.argwhere(cells)] == [
        (0, 0, 0),
        (0, 0, 1),
        (0, 1, 0),
        (0, 1, 1),
        (0, 2, 2),
        (1, 0, 0),
        (1, 0, 1),
        (1, 1, 0),
        (1, 1, 1),
        (1, 2, 2),
        (2, 2, 2),
    ]


def test_inactive_modules_are_as_if_they_were_not_there(tmp_path: Path) -> None:
    modules = {
        "top": {"INCLUDE_AND": {"a": "x"}, "EXCLUDE_OR": {"off": True, "b": "y"}},
        "off": {"ACTIVE": False, "INCLUDE_AND": {"b": "z"}},
    }
    space = read(
        tmp_path, {"TAXONOMY": {"a": ["x", "y"], "b": ["x", "y", "z"]}, "MODULES": modules}
    )
    assert space.clauses == (("a != y",), ("b != y",))


@pytest.mark.parametrize(
    ("section", "labels", "clause"),
    [
        (
            {"EXCLUDE_AND": {"speed": ["> 60 km/h"]}},
            ("[0, 30)", "[30, 60)", "[60, inf]"),
            ("speed != [60, inf]",),
        ),
        (
            {"INCLUDE_AND": {"speed": ["< 60 km/h"]}},
            ("[0, 30)", "[30, 60)", "[60, inf]"),
            ("speed != [60, inf]",),
        ),
        (
            {"INCLUDE_AND": {"speed": ["< 10 km/h", "> 60 km/h"]}},
            ("[0, 10)", "[10, 30)", "[30, 60)", "[60, inf]"),
            ("speed = [0, 10)", "speed = [60, inf]"),
        ),
    ],
)
def test_bounds_in_a_list_cut_like_bounds_alone(
    section: Any, labels: tuple[str, ...], clause: tuple[str, ...], tmp_path: Path
) -> None:
    coverage = {"CUTS": {"speed": ["30 km/h"]}}
    space = read(
        tmp_path,
        {"TAXONOMY": {"speed": "float velocity"}, "MODULES": {"m": section}, "COVERAGE": coverage},
    )
    assert space.variables[0].labels == labels and space.clauses == (clause,)


@pytest.mark.parametrize(
    ("text", "unit", "first_inside"),
    [
        ("> 3.5 m/s", "m/s", 4),
        ("> 3 m/s", "m/s", 4),
        (">= 3.5 m/s", "m/s", 4),
        (">= 3 m/s", "m/s", 3),
        ("> 30 mph", "km/h", 49),
    ],
)
def test_whole_numbers_begin_at_the_first_inside(
    text: str, unit: str, first_inside: int, tmp_path: Path
) -> None:
    coverage = {"CUTS": {"speed": [f"90 {unit}"]}}
    space = read(
        tmp_path,
        {
            "TAXONOMY": {"speed": "integer velocity"},
            "MODULES": {"m": {"EXCLUDE_AND": {"speed": text}}},
            "COVERAGE": coverage,
        },
    )
    allowed = space.constraints.holds(
        space.categorise(np.array([[first_inside - 1.0], [first_inside]]))
    )
    assert space.variables[0].unit == unit and allowed.tolist() == [True, False]


@pytest.mark.parametrize(
    ("text", "first_outside"),
    [("< 3.5 m/s", 4), ("<= 3.5 m/s", 4), ("< 3 m/s", 3), ("<= 3 m/s", 4), ("[2.5 .. 3.5] m/s", 4)],
)
def test_whole_numbers_end_after_the_last_inside(
    text: str, first_outside: int, tmp_path: Path
) -> None:
    space = read(
        tmp_path,
        {
            "TAXONOMY": {"speed": "integer velocity"},
            "MODULES": {"m": {"INCLUDE_AND": {"speed": text}}},
        },
    )
    assert space.constraints.holds(
        space.categorise(np.array([[first_outside - 1.0], [first_outside]]))
    ).tolist() == [True, False]


def test_bounds_inside_a_category_are_refused() -> None:
    concept, speed = (
        Concept(("speed",), unit_type="velocity"),
        Variable("speed", "continuous", "m/s", 0, np.inf, cuts=(10,)),
    )
    assert categories_meant(concept, concept, speed, "< 10 m/s") == {0}
    for text in ("< 20 m/s", "> 5 m/s", "[10 .. 20] m/s"):
        with pytest.raises(ValueError, match="cuts through a category of speed"):
            categories_meant(concept, concept, speed, text)


def test_units_are_converted() -> None:
    assert converted(36, "km/h", "m/s", "velocity") == 10 and converted(
        50, "km/h", "mph", "velocity"
    ) == pytest.approx(31.0686, abs=1e-4)
    assert (
        converted(32, "F", "C", "temperature") == 0
        and converted(0, "C", "K", "temperature") == 273.15
    )
    assert (
        bounds("[1 .. 2] m").low,
        bounds("<3km").unit,
        bounds("5").high,
        bounds("< 1.5e3 lux").high,
    ) == (1, "km", 5, 1500)


SMALL = {
    "TAXONOMY": {"road": ["city", "rural"], "speed": "float velocity"},
    "MODULES": {"m": {"INCLUDE_AND": {"speed": "< 50 km/h"}}},
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"COD": []}, "COD is not read"),
        ({"TAXONOMY": []}, "TAXONOMY: expected a mapping, got []"),
        (
            {"TAXONOMY": {"road": "colour"}},
            "TAXONOMY.road: expected a record, a list of literals, boolean, shapefile or a number",
        ),
        (
            {"TAXONOMY": {"road": ["a", "a"]}},
            "TAXONOMY.road: expected a list of distinct literals, got ['a', 'a']",
        ),
        (
            {"TAXONOMY": {"speed": "float velocity", "car": {"speed": "float velocity"}}},
            "TAXONOMY.speed: this concept is declared twice",
        ),
        (
            {"TAXONOMY": {"speed": "float velocity", "area": "shapefile"}},
            "TAXONOMY.area: a shape file has no categories, or leave it out",
        ),
        (
            {"TAXONOMY": {"speed": "float velocity", "width": "float length"}},
            "TAXONOMY.width: no statement compares this number",
        ),
        (
            {
                "TAXONOMY": {
                    "speed": "float velocity",
                    "x": {"a": {"speed": "< 3 m/s"}, "b": {"speed": "> 2 m/s"}},
                }
            },
            "ranges of a and b overlap",
        ),
        (
            {"MODULES": {"m": {"INCLUDE_AND": {"speeed": "< 5 m/s"}}}},
            "MODULES.m.INCLUDE_AND.speeed: there is no concept speeed; did you mean",
        ),
        (
            {
                "MODULES": {"m": {"INCLUDE_AND": {"speed": "< 5 kg"}}},
                "COVERAGE": {"CUTS": {"speed": ["3 m/s"]}},
            },
            "'kg' is not a unit of velocity",
        ),
        (
            {"MODULES": {"m": {"INCLUDE_AND": {"speed": "fast"}}}},
            "INCLUDE_AND.speed: expected a number with a unit, '< x', '> x' or '[x .. y]'",
        ),
        (
            {"MODULES": {"m": {"INCLUDE_AND": {"speed": "50 km/h"}}}},
            "50 km/h is a single number, which is not a category; use a range",
        ),
        (
            {"MODULES": {"m": {"INCLUDE_AND": {"road": "sity", "speed": "< 5 m/s"}}}},
            "is not a literal of road; did you mean 'city'?",
        ),
        (
            {"MODULES": {"m": {"INCLUDE_AND": {"road": [], "speed": "< 5 m/s"}}}},
            "MODULES.m: no combination satisfies it",
        ),
        (
            {"MODULES": {"m": {"INCLUDE_AND": []}}},
            "MODULES.m.INCLUDE_AND: expected conditions such as",
        ),
        (
            {"MODULES": {"m": {"INCLUDED": {}}}},
            "MODULES.m: unknown key 'INCLUDED'; did you mean 'INCLUDE_AND'?",
        ),
        ({"MODULES": {"m": {"TITLE": "x"}}}, "MODULES.m: expected at least one of INCLUDE_AND"),
        (
            {"MODULES": {"m": {"INCLUDE_AND": {"a": "x"}, "INCLUDE_OR": {"a": "x"}}}},
            "MODULES.m: expected at most one INCLUDE section",
        ),
        (
            {"MODULES": {"m": {"INCLUDE_AND": {"AND": {"road": "city"}}}}},
            "INCLUDE_AND.AND: expected the other operator inside AND",
        ),
        (
            {"MODULES": {"m": {"INCLUDE_AND": {"n": True}}, "n": {"INCLUDE_AND": {"m": True}}}},
            "MODULES: another module refers to each of them; leave at least one",
        ),
        (
            {"MODULES": {"m": {"INCLUDE_AND": {"n": True}}, "n": {"INCLUDE_AND": {"n": True}}}},
            "MODULES.n: this module refers to itself, by n → n",
        ),
        (
            {
                "MODULES": {
                    "m": {"INCLUDE_AND": {"n": "maybe"}},
                    "n": {"INCLUDE_AND": {"road": "city"}},
                }
            },
            "expected true or false, got 'maybe'",
        ),
        (
            {
                "MODULES": {"m": {"INCLUDE_AND": {"road": "city"}}},
                "ODD": {"m": {"INCLUDE_AND": {"road": "city"}}},
            },
            "MODULES.m: this module appears twice",
        ),
        ({"COVERAGE": {"CUT": {}}}, "COVERAGE: unknown key 'CUT'; did you mean 'CUTS'?"),
        (
            {"COVERAGE": {"CUTS": {"road": ["3"]}}},
            "COVERAGE.CUTS.road: expected a number, got road with city, rural",
        ),
        (
            {"COVERAGE": {"CONCEPTS": ["rode"]}},
            "COVERAGE.CONCEPTS: there is no record or concept rode; did you mean 'road'?",
        ),
        (
            {"COVERAGE": {"CONCEPTS": ["road"]}},
            "speed is not among COVERAGE.CONCEPTS, so this cannot be checked",
        ),
        (
            {"COVERAGE": {"OPTIONAL": ["speed"]}},
            "TAXONOMY.speed: a number that may not apply needs literals",
        ),
        (
            {"COVERAGE": {"APPLIES_IF": {"road": "city"}}},
            "COVERAGE.APPLIES_IF.road: expected conditions such as",
        ),
        ({"IMPORT": ["nowhere.yaml"]}, "nowhere.yaml: expected a YAML file, got no such file"),
        ({"IMPORT": "x"}, "IMPORT: expected a list of files, got 'x'"),
        (
            {
                "TAXONOMY": {
                    "r": "float length",
                    "l": {"a": {"r": "< 2 m"}, "b": {"r": ">= 2 m"}},
                    "speed": "float velocity",
                },
                "MODULES": {"m": {"INCLUDE_AND": {"r": "< 3 m", "speed": "< 3 m/s"}}},
            },
            "INCLUDE_AND.r: this cuts through the literal b of l",
        ),
        (
            {
                "TAXONOMY": {
                    "r": "float length",
                    "l": {"a": {"r": "[0 .. 2] m"}, "b": {"r": "> 2 m"}},
                },
                "MODULES": {"m": {"EXCLUDE_AND": {"r": "2 m"}}},
            },
            "EXCLUDE_AND.r: 2 m is a single number, which is no literal of l; use a range",
        ),
    ],
)
def test_what_a_space_cannot_say_is_refused_by_place(
    change: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as refused:
        read(tmp_path, {**SMALL, **change})
    assert message in str(refused.value) and str(tmp_path) in str(refused.value)


def test_imports_are_read_once_and_may_not_contradict(tmp_path: Path) -> None:
    (tmp_path / "taxonomy.yaml").write_text(
        "IMPORT: [odd.yaml]\nTAXONOMY: {scenery: {road: [city, rural]}}"
    )
    space = read(
        tmp_path,
        "IMPORT: [taxonomy.yaml]\nTAXONOMY: {scenery: {lit: boolean}}\nMODULES: "
        "{m: {EXCLUDE_OR: {road: rural}}}",
    )
    assert space.names == ("road", "lit") and space.clauses == (("road != rural",),)
    with pytest.raises(
        InputError, match=r"odd.yaml: TAXONOMY.scenery.road: an imported file has this, too"
    ):
        read(tmp_path, "IMPORT: [taxonomy.yaml]\nTAXONOMY: {scenery: {road: [city]}}")
