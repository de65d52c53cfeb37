"""Damaged tables and space files.

Refused in one line that names the file, or counted as plain enumeration counts them.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from fractions import Fraction
from itertools import combinations, pairwise, product
from math import prod
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import example, given, settings

from pipeline.__main__ import main
from tests.laws.mutations import CHANGES, mutated

SPACE = """variables:
  sky: {values: [on, off, 1.10, 1.1], weights: {off: 2}}
  fog: {interval: [0, 100], cuts: [20, 50], unit: "%"}
  turn: {interval: [0, 360], cuts: [90, 270], cyclic: true}
  lanes: {values: [1, 2]}
constraints:
  - [lanes = 2, sky != off]
  - [sky != 1.1, "fog = [0, 20)"]
"""
TABLE = (
    'sky,fog,turn,lanes,note\non,3,350,1,"a, b"\noff,20,90,2,\n1.10,100,10,1,c\n1.1,"[0, '
    '20)",180,2.0,d\noff,7,7,1,e\n,55,,1,f\n'
)


def meaning(body: dict[str, Any], text: str) -> int | None:
    """The category of a table's text, by the words of the how-to alone."""
    text = text.strip()
    number = (
        Fraction(text)
        if re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?", text)
        else None
    )
    if "values" in body:
        if text in body["values"]:
            return int(body["values"].index(text))
        same = [
            i
            for i, name in enumerate(body["values"])
            if number is not None and _number(name) == number
        ]
        return same[0] if len(same) == 1 else None
    names = labels(body)
    if text in names:
        return names.index(text)
    low, high = map(float, body["interval"])
    if number is None or not low <= float(number) <= high:
        return None
    part = sum(float(cut) <= float(number) for cut in body.get("cuts", []))
    return (part - 1) % len(names) if body.get("cyclic") == "true" and body.get("cuts") else part


def _number(text: str) -> Fraction | None:
    try:
        return Fraction(text)
    except ValueError:
        return None


def labels(body: dict[str, Any]) -> list[str]:
    """Names of the parts of an interval whose numbers are whole."""
    low, high = body["interval"]
    ends = [
        format(Fraction(end).numerator) if Fraction(end).denominator == 1 else repr(float(end))
        for end in (low, *body.get("cuts", []), high)
    ]
    parts = [f"[{a}, {b})" for a, b in pairwise(ends)]
    if body.get("cyclic") == "true" and body.get("cuts"):
        return [*parts[1:-1], f"[{ends[-2]}, {ends[1]})"]
    return [*parts[:-1], parts[-1][:-1] + "]"]


def counted(space: dict[str, Any], table: str) -> dict[str, Any]:
    """Rows, partial and left-out rows, and coverage for k = 1 and 2, by trying every point of the
    space.
    """
    bodies = list(space["variables"].values())
    names = [body.get("values") or labels(body) for body in bodies]
    order = list(space["variables"])

    def keeps(point: tuple[int, ...]) -> bool:
        named = {(order[v], names[v][c]) for v, c in enumerate(point)}
        return all(
            any(_holds(literal, named) for literal in clause)
            for clause in space.get("constraints") or []
        )

    feasible = [point for point in product(*(range(len(n)) for n in names)) if keeps(point)]
    table = re.sub(
        '[ \t]+(?=")', "", table.removeprefix("\ufeff")
    )  # Python's reader skips spaces before a quote, but not tabs.
    rows = [row for row in csv.reader(io.StringIO(table, newline=""), skipinitialspace=True) if row]
    head = [name.strip() for name in rows[0]]
    named = [
        [meaning(body, row[head.index(name)]) for name, body in zip(order, bodies, strict=True)]
        for row in rows[1:]
    ]
    kept = [
        row
        for row in named
        if any(all(c in (None, p) for c, p in zip(row, point, strict=True)) for point in feasible)
    ]
    result: dict[str, Any] = {
        "rows": len(named),
        "left_out": len(named) - len(kept),
        "partial": sum(None in row for row in kept),
    }
    for k in (1, 2):
        covered = required = 0
        for plane in combinations(range(len(order)), k):
            counts = Counter(tuple(row[v] for v in plane) for row in kept)
            for cell in {tuple(point[v] for v in plane) for point in feasible}:
                weight = prod(
                    _weight(bodies[v], names[v], c) for v, c in zip(plane, cell, strict=True)
                )
                covered, required = covered + min(counts[cell], weight), required + weight
        result[f"k = {k}"] = (covered, required)
    return result


def _holds(literal: str, named: set[tuple[str, str]]) -> bool:
    name, sign, category = (part.strip() for part in re.split("(!?=)", literal, maxsplit=1))
    return ((name, category) in named) == (sign == "=")


def _weight(body: dict[str, Any], names: list[str], category: int) -> int:
    weights = body.get("weights", {})
    return (
        int(weights[category])
        if isinstance(weights, list)
        else int(weights.get(names[category], 1))
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("mutated")


def check(folder: Path, space: str, table: str) -> bool:
    """Whether the files are counted, rightly; else they are refused in one line."""
    (folder / "space.yaml").write_bytes(space.encode())
    (folder / "points.csv").write_bytes(table.encode())
    words = [
        "coverage",
        "score",
        "--space",
        str(folder / "space.yaml"),
        "--points",
        str(folder / "points.csv"),
        "--json",
    ]
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as error:
        code = main(words)
    if code:
        line = error.getvalue().splitlines()[-1]
        named = re.search(rf"{re.escape(str(folder))}/(space.yaml|points.csv)(, line \d+)?: ", line)
        assert code == 2 and not out.getvalue() and named
        return False
    result = json.loads(out.getvalue())
    shown = {key: result[key] for key in ("rows", "left_out", "partial")}
    shown |= {f"k = {row['k']}": (row["numerator"], row["denominator"]) for row in result["by_k"]}
    assert shown == counted(yaml.load(space, yaml.BaseLoader), table)
    return True


def test_undamaged_files_are_counted(folder: Path) -> None:
    assert check(folder, SPACE, TABLE)


@pytest.mark.parametrize("kind", ["space", "table"])
@settings(max_examples=60)
@given(changes=CHANGES)
@example(changes=[(75, 0, "\t")])
def test_damaged_files_are_refused_by_name_or_counted_rightly(
    folder: Path, kind: str, changes: list[tuple[int, int, str]]
) -> None:
    check(
        folder,
        *(
            (mutated(SPACE, changes), TABLE)
            if kind == "space"
            else (SPACE, mutated(TABLE, changes))
        ),
    )
