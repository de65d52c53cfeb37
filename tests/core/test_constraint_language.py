"""The constraint language: by hand, and random texts against a direct evaluation."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pipeline.artefacts.scenario_space import ScenarioInfo, read_space, write_space
from pipeline.artefacts.space_file import read_space_file
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError

DRIVE = (
    Variable("weather", "categorical", values=("sunny", "rainy", "fog")),
    Variable("fog", "continuous", "%", 0, 100, cuts=(20, 50, 80)),
    Variable("lights", "categorical", values=("on", "low", "off")),
    Variable("lane", "categorical", values=("1", "2", "3")),
    Variable("lanes", "categorical", values=("1", "2", "3.0")),
    Variable("speed", "continuous", "km/h", 0, 130, cuts=(30, 50)),
    Variable("limit", "categorical", values=("30", "50", "131")),
    Variable("azimuth", "continuous", "deg", 0, 360, cyclic=True, cuts=(90, 270)),
    Variable("rain", "continuous", "", 0, 1, 0.1),
    Variable("road type", "categorical", values=("it's = wet", 'the "dry" one')),
)
NAMES = [variable.name for variable in DRIVE]


def allowed(text: str, *shown: str) -> list[tuple[str, ...]]:
    """The categories of the shown variables that some allowed row has."""
    space = Space(DRIVE, (text,))
    columns = [NAMES.index(name) for name in shown]
    cells = np.argwhere(space.constraints.feasible_cells(columns))
    labels = [DRIVE[v].labels for v in columns]
    return [tuple(map(operator.getitem, labels, cell)) for cell in cells.tolist()]


@pytest.mark.parametrize(
    ("text", "shown", "gone"),
    [
        (
            "if fog >= 50 then lights in {on, low}",
            ("fog", "lights"),
            {("[50, 80)", "off"), ("[80, 100]", "off")},
        ),
        (
            "fog >= 80 => lights = on",
            ("fog", "lights"),
            {("[80, 100]", "low"), ("[80, 100]", "off")},
        ),
        (
            "IF fog < 20 THEN lights = off ELSE lights NOT IN {off}",
            ("fog", "lights"),
            {
                ("[0, 20)", "on"),
                ("[0, 20)", "low"),
                ("[20, 50)", "off"),
                ("[50, 80)", "off"),
                ("[80, 100]", "off"),
            },
        ),
        ("lane <= lanes", ("lane", "lanes"), {("2", "1"), ("3", "1"), ("3", "2")}),
        ("lane = lanes or lanes > 1", ("lane", "lanes"), {("2", "1"), ("3", "1")}),
        (
            "speed < limit",
            ("speed", "limit"),
            {("[30, 50)", "30"), ("[50, 130]", "30"), ("[50, 130]", "50")},
        ),
        (
            "not (rain > 0.3) and rain != 0",
            ("rain",),
            {(x,) for x in ("0", "0.4", "0.5", "0.6", "0.7", "0.8", "0.9", "1")},
        ),
        ("'road type' = 'it''s = wet'", ("road type",), {('the "dry" one',)}),
        ('"road type" in {"it\'s = wet"}', ("road type",), {('the "dry" one',)}),
        ("weather in {fog}", ("weather",), {("sunny",), ("rainy",)}),
        ('not not fog="[0, 20)"', ("fog",), {("[20, 50)",), ("[50, 80)",), ("[80, 100]",)}),
        ("fog <= 100", ("fog",), set()),
    ],
)
def test_a_text_excludes_what_it_says(
    text: str, shown: tuple[str, ...], gone: set[tuple[str, ...]]
) -> None:
    every = set(product(*(DRIVE[NAMES.index(name)].labels for name in shown)))
    assert set(allowed(text, *shown)) == every - gone


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "constraint '', character 1: expected a variable, not or '(', got the end"),
        ("if fog >= 50 lights = on", "character 14: expected and, or, => or then, got 'lights'"),
        ("fog >= 50 and", "character 14: expected a variable, not or '(', got the end"),
        ("(lane = 1", "character 10: expected and, or, => or ')', got the end"),
        ("lane = 1 lights = on", "character 10: expected and, or, => or the end, got 'lights'"),
        ("fog 50", "character 5: expected =, !=, <, <=, >, >=, in or not in, got '50'"),
        ("fog => 50", "character 5: expected =, !=, <, <=, >, >=, in or not in, got '=>'"),
        ("lights in on", "character 11: expected '{', got 'on'"),
        ("lights in {on low}", "character 15: expected ',' or '}', got 'low'"),
        ("lights in {}", "character 12: expected a category, got '}'"),
        ("lights not on", "character 12: expected in, got 'on'"),
        ("lane = then", "character 8: expected a category, a number or a variable, got 'then'; "
                        "put a name like this in quotes"),
        ("lane = 'x", "character 8: this quote does not end"),
        ("lane ! 1", "character 6: expected a name, a number or a sign, got '!'"),
        ("foog >= 50", "character 1: variable must be one of weather, fog, lights, lane, lanes, "
                       "speed, limit, azimuth, rain, road type; "
         "got 'foog'; did you mean 'fog'?"),
        ("weather = sunni", "character 11: category must be one of sunny, rainy, fog; got "
                            "'sunni'; did you mean 'sunny'?"),
        ("lights in {on, lowe}", "character 16: category must be one of on, low, off; got 'lowe'; "
                                 "did you mean 'low'?"),
        ("weather = fog", "character 11: 'fog' is a category of weather and a variable; for the "
                          "category write in {…}"),
        ("weather < 3", "only numbers compare by <, <=, > and >=, and a category of weather is "
                        "'sunny'; use = or in {…}"),
        ("lane < weather", "only numbers compare by <, <=, > and >=, and a category of weather is "
                           "'sunny'"),
        ("fog < low", "character 7: expected a number or a variable after <, got 'low'"),
        ("fog > 50", "fog > 50 holds for some values of the category [50, 80), and not for "
                     "others; write >= 50, or choose other cuts"),
        ("fog < 30", "some values of the category [20, 50), and not for others; compare with a "
                     "cut (20, 50, 80), or name the category"),
        ("azimuth < 90", "some values of the category [270, 90), and not for others"),
        ("speed <= fog", "speed <= fog holds for some values of the categories [0, 30) and [0, "
                         "20), and not for others; name"),
        ("speed <= limit", "holds for some values of the categories [30, 50) and 30, and not for "
                           "others"),
        ("lane = lane", "lane = lane compares a variable with itself"),
        ("weather = lights", "weather = lights compares variables that have no category in common"),
        ("lane = 1 and lane = 2", "these contradict each other, so no point is left: lane = 1 and "
                                  "lane = 2"),
        ("fog > 200", "no combination satisfies it"),
        ("(" * 51 + "lane = 1" + ")" * 51, "character 51: nested deeper than 50 levels"),
    ],
)  # fmt: skip
def test_a_wrong_text_is_refused_where_it_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        Space(DRIVE, (text,))


def test_variables_with_many_categories_are_compared_up_to_a_limit() -> None:
    def linked(size: int) -> Space:
        values = tuple(map(str, range(size)))
        return Space(
            (
                Variable("a", "categorical", values=values),
                Variable("b", "categorical", values=values),
            ),
            ("a <= b",),
        )

    assert len(linked(300).constraints.clauses) == 299
    with pytest.raises(
        ValueError, match="a <= b compares 250,000 pairs of categories, more than 200,000"
    ):
        linked(500)


def test_texts_that_contradict_each_other_are_named() -> None:
    with pytest.raises(
        ValueError,
        match=r"no point is left: if lane >= 2 then lanes = 1; \[lane != 1\]; lanes > 1$",
    ):
        Space(
            DRIVE, ("if lane >= 2 then lanes = 1", ("fog != [0, 20)",), ("lane != 1",), "lanes > 1")
        )


def test_a_broken_text_is_named_as_it_is_written() -> None:
    text = "if lane >= 2 then lanes >= 2 and lights in {on, low}"
    space = Space(DRIVE, (("weather != rainy", "lights = on"), text, "lane <= lanes"))
    assert [space.clause(i) for i in range(len(space.constraints.clauses))] == [
        "weather != rainy or lights = on", text, text, "lane <= lanes", "lane <= lanes",
    ]  # fmt: skip
    point = np.zeros(len(DRIVE))
    point[NAMES.index("lane")] = 1
    assert space.violation(point[None]) == (
        0,
        f"breaks the constraint '{text}': lane = 2, lanes = 1",
    )


def test_files_hold_texts_beside_clauses(tmp_path: Path) -> None:
    path = tmp_path / "space.yaml"
    head = (
        "variables: {fog: {interval: [0, 100], cuts: [50]}, lights: {values: [on, low, off]}, "
        "'a: b': {values: [1, 2]}}\nconstraints:\n"
    )
    path.write_text(
        head
        + "  - if fog >= 50 then lights in {on, low}\n  - [lights != off, 'a: b = 2']\n  - '\"a: "
        "b\" = 2 or lights = off'\n"
    )
    space = read_space_file(path)
    assert (
        space.clauses[0] == "if fog >= 50 then lights in {on, low}"
        and space.clauses[2] == '"a: b" = 2 or lights = off'
    )
    assert space.constraints.feasible_cells([0, 1]).tolist() == [[True] * 3, [True, True, False]]
    path.write_text(head + "  - {if: fog}\n")
    with pytest.raises(
        InputError,
        match="space.yaml: constraints: expected a text such as 'if fog >= 50 then lights in {on, "
        "low}'",
    ):
        read_space_file(path)
    write_space(tmp_path / "F1.json", ScenarioInfo("F1", "one", "text", 3), space)
    assert read_space(tmp_path / "F1.json")[1].clauses == space.clauses


COMPARED: dict[str, Callable[[Any, Any], bool]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
Value = tuple[str, float | None]
"""The name of a value's category, and the value if it is a number."""
Row = dict[str, Value]


@dataclass(frozen=True)
class Said:
    """A text, its direct evaluation on the values of a row, and the comparisons in it."""

    text: str
    holds: Callable[[Row], bool]
    parts: tuple[Said, ...] = ()

    def comparisons(self) -> list[Said]:
        if not self.parts:
            return [self]
        return list(chain.from_iterable(part.comparisons() for part in self.parts))


def quoted(draw: st.DrawFn, name: str) -> str:
    if (
        re.fullmatch(r"[a-z0-9.]+", name)
        and name not in ("if", "then", "else", "and", "or", "not", "in")
        and draw(st.booleans())
    ):
        return name
    quote = draw(st.sampled_from("'\""))
    return quote + name.replace(quote, quote * 2) + quote


@st.composite
def variables(draw: st.DrawFn) -> tuple[Variable, ...]:
    texts = draw(st.lists(st.text(min_size=1, max_size=5), min_size=6, max_size=6, unique=True))
    names, drawn = [f"{text}_" for text in texts[:3]], []
    for name in names:
        kind = draw(st.sampled_from(("names", "numbers", "cuts", "step", "cyclic")))
        if kind == "names":
            drawn.append(
                Variable(name, "categorical", values=tuple(texts[3 : 3 + draw(st.integers(1, 3))]))
            )
        elif kind == "numbers":
            values = draw(
                st.lists(
                    st.sampled_from(("0", "1", "2", "2.0", "5", "-1")),
                    min_size=1,
                    max_size=4,
                    unique=True,
                )
            )
            drawn.append(Variable(name, "categorical", values=tuple(values)))
        elif kind == "step":
            drawn.append(Variable(name, "continuous", "", 0, 3, 1))
        else:
            cyclic = kind == "cyclic"
            cuts = sorted(draw(st.sets(st.integers(1, 4), min_size=2 if cyclic else 0, max_size=3)))
            drawn.append(
                Variable(name, "continuous", "", 0, 5, cyclic=cyclic, cuts=tuple(map(float, cuts)))
            )
    return tuple(drawn)


def values_of(variable: Variable) -> list[list[Value]]:
    """For each category, values that stand for all of it in comparisons with whole numbers."""
    of_category: list[list[Value]] = [[] for _ in variable.labels]
    if variable.cuts is None:
        return [
            [(label, float(label) if re.fullmatch(r"-?\d+(\.\d)?", label) else None)]
            for label in variable.labels
        ]
    points = np.arange(variable.low, variable.high + 0.1, 0.25)
    for point, category in zip(points, variable.categorise(points), strict=True):
        of_category[category].append((variable.labels[category], float(point)))
    return of_category


@st.composite
def comparison(draw: st.DrawFn, space: tuple[Variable, ...]) -> Said:
    first = draw(st.sampled_from(space))
    name, kind = (
        quoted(draw, first.name),
        draw(st.sampled_from(("list", "category", "constant", "variable"))),
    )
    if kind == "list":
        chosen = draw(st.lists(st.sampled_from(first.labels), min_size=1, max_size=3))
        word, inside = draw(st.sampled_from((("in", True), ("not in", False))))
        listed = ", ".join(quoted(draw, label) for label in chosen)
        return Said(
            f"{name} {word} {{{listed}}}", lambda row: (row[first.name][0] in chosen) == inside
        )
    if kind == "category":
        label, sign = draw(st.sampled_from(first.labels)), draw(st.sampled_from(("=", "!=")))
        return Said(
            f"{name} {sign} {quoted(draw, label)}",
            lambda row: COMPARED[sign](row[first.name][0], label),
        )
    if kind == "constant":
        number, sign = draw(st.integers(-1, 6)), draw(st.sampled_from(("<", "<=", ">", ">=")))
        return Said(f"{name}{sign}{number}", lambda row: COMPARED[sign](row[first.name][1], number))
    other, sign = draw(st.sampled_from(space)), draw(st.sampled_from(sorted(COMPARED)))
    # Two variables compare as numbers if both have only numbers.
    by = (
        1
        if all(
            value is not None
            for v in (first, other)
            for several in values_of(v)
            for _, value in several
        )
        else 0
    )
    return Said(
        f"{name} {sign} {quoted(draw, other.name)}",
        lambda row: COMPARED[sign](row[first.name][by], row[other.name][by]),
    )


def joined(draw: st.DrawFn, space: tuple[Variable, ...], depth: int) -> Said:
    kind = (
        draw(st.sampled_from(("first", "not", "and", "or", "=>", "if", "else")))
        if depth
        else "first"
    )
    if kind == "first":
        return draw(comparison(space))
    a, b, c = (joined(draw, space, depth - 1) for _ in range(3))
    x, y, z = (f"({part.text})" for part in (a, b, c))
    texts: dict[str, tuple[str, Callable[[Row], bool], tuple[Said, ...]]] = {
        "not": (f"not {x}", lambda row: not a.holds(row), (a,)),
        "and": (
            f"{x} and {y} and {z}",
            lambda row: a.holds(row) and b.holds(row) and c.holds(row),
            (a, b, c),
        ),
        "or": (
            f"{x} or {y} and {z}",
            lambda row: a.holds(row) or (b.holds(row) and c.holds(row)),
            (a, b, c),
        ),
        "=>": (
            f"{x} => {y} => {z}",
            lambda row: not a.holds(row) or not b.holds(row) or c.holds(row),
            (a, b, c),
        ),
        "if": (f"if {a.text} then {b.text}", lambda row: not a.holds(row) or b.holds(row), (a, b)),
        "else": (
            f"if {a.text} then {y} else {c.text}",
            lambda row: b.holds(row) if a.holds(row) else c.holds(row),
            (a, b, c),
        ),
    }
    return Said(*texts[kind])


def outcomes(statement: Said, space: tuple[Variable, ...]) -> list[set[bool]]:
    """Whether a text holds, for some values of each row of categories, in the order of the rows."""
    names, values = [variable.name for variable in space], list(map(values_of, space))
    results = []
    for cell in product(*values):
        rows = (dict(zip(names, row, strict=True)) for row in product(*cell))
        results.append({statement.holds(row) for row in rows})
    return results


UNCOMPARED = ("compares a variable with itself", "no category in common", "compare by <")


@given(st.data())
def test_clauses_allow_exactly_the_rows_in_which_the_text_holds(data: st.DataObject) -> None:
    space = data.draw(variables())
    statement = data.draw(st.composite(joined)(space, data.draw(st.integers(0, 2))))
    rows = np.array(list(product(*(range(variable.size) for variable in space))))
    refused = ""
    try:
        allowed = Space(space, (statement.text,)).constraints.holds(rows).tolist()
    except ValueError as error:
        refused, allowed = str(error), [False] * len(rows)
    assume(not any(words in refused for words in UNCOMPARED))
    if "holds for some values" in refused:
        assert any({True, False} in outcomes(part, space) for part in statement.comparisons()), (
            statement.text,
            refused,
        )
        return
    assert not refused or re.search("no combination satisfies it|no point is left", refused)
    assert [{holds} for holds in allowed] == outcomes(statement, space), statement.text
