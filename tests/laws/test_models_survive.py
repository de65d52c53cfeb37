"""PICT and ACTS models become a space and models again without a change of meaning.

They mean the rows that their documentation gives.
"""

from __future__ import annotations

import operator
import random
import re
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.artefacts.model_export import write_model
from pipeline.artefacts.space_formats import read_space_of_any_format
from pipeline.core.space import Space
from pipeline.errors import InputError

PARAMETERS = {
    "File system": ["FAT", "fat32", "NTFS"],
    "Size": ["1", "2.5", "10"],
    "Copy size": ["1", "2", "10", "40"],
    "mode": ["quick", "NTFS"],
}
RELATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "=": operator.eq,
    "<>": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
Row = dict[str, Any]
Said = tuple[str, Callable[[Row], bool]]
"""A condition's text, and whether it holds for a row of values."""


def allowed(space: Space) -> set[tuple[str, ...]]:
    """The rows that keep the constraints, by their values."""
    rows = np.array(list(product(*map(range, space.sizes))))
    return {tuple(names.values()) for names in space.names_of(rows[space.constraints.holds(rows)])}


def value_of(name: str, text: str) -> Any:
    return float(text) if "ize" in name else text.lower()


def pict_term(rng: random.Random) -> Said:
    name = rng.choice(list(PARAMETERS))
    numeric, known = "ize" in name, PARAMETERS[name]
    kind = rng.choice(["value", "value", "set", "pair", *([] if numeric else ["like"])])
    if kind == "pair":
        other = rng.choice([p for p in PARAMETERS if ("ize" in p) == numeric])
        sign = rng.choice(list(RELATIONS))
        return f"[{name}] {sign} [{other}]", lambda row: RELATIONS[sign](
            value_of(name, row[name]), value_of(other, row[other])
        )
    if kind == "like":
        return f'[{name}] {rng.choice(["like", "LIKE"])} "?a*"', lambda row: bool(
            re.fullmatch(".a.*", row[name].lower())
        )
    shown = [text if numeric else f'"{text.upper()}"' for text in rng.sample(known, 2)]
    values = [value_of(name, text.strip('"')) for text in shown]
    if kind == "set":
        negated = rng.random() < 0.4
        inside = f"[{name}] {'NOT ' if negated else ''}IN {{{', '.join(shown)}}}"
        return inside, lambda row: (value_of(name, row[name]) in values) != negated
    sign = rng.choice(list(RELATIONS))
    return f"[{name.upper()}] {sign} {shown[0]}", lambda row: RELATIONS[sign](
        value_of(name, row[name]), values[0]
    )


def pict_condition(rng: random.Random, depth: int = 2) -> Said:
    """Without parentheses where PICT's priorities, NOT before AND before OR, say the same."""
    if depth == 0 or rng.random() < 0.3:
        text, holds = pict_term(rng)
        return (f"NOT {text}", lambda row: not holds(row)) if rng.random() < 0.2 else (text, holds)
    (one, first), (two, second) = pict_condition(rng, depth - 1), pict_condition(rng, depth - 1)
    if rng.random() < 0.5:
        return f"({one}) AND NOT ({two})", lambda row: first(row) and not second(row)
    return f"{one} OR {two}", lambda row: first(row) or second(row)


def pict_constraint(rng: random.Random) -> Said:
    one, first = pict_condition(rng)
    if rng.random() < 0.4:
        return f"({one});", first
    two, second = pict_condition(rng, 1)
    if rng.random() < 0.5:
        return f"IF {one}\nTHEN {two};", lambda row: second(row) if first(row) else True
    three, third = pict_condition(rng, 1)
    return f"if {one} # THEN\n\nthen {two} ELSE {three};".replace(
        " # THEN", ""
    ), lambda row: second(row) if first(row) else third(row)


@pytest.mark.parametrize("seed", range(60))
def test_pict_models_allow_the_rows_of_their_documentation(seed: int, tmp_path: Path) -> None:
    rng = random.Random(seed)
    constraints = [pict_constraint(rng) for _ in range(rng.randint(1, 3))]
    names = list(PARAMETERS)
    rows = [dict(zip(names, values, strict=True)) for values in product(*PARAMETERS.values())]
    expected = {tuple(row.values()) for row in rows if all(holds(row) for _, holds in constraints)}
    model = tmp_path / "model.txt"
    parameters = [f"{name} : {', '.join(values)}" for name, values in PARAMETERS.items()]
    model.write_text("\n".join(["# A model", *parameters, "", *(text for text, _ in constraints)]))
    if not expected:
        with pytest.raises(InputError, match="no combination satisfies|contradict"):
            read_space_of_any_format(model)
        return
    space = read_space_of_any_format(model)
    assert allowed(space) == expected
    for again in ("again.txt", "again.yaml"):
        write_model(tmp_path / again, space, "pict" if again.endswith("txt") else "space")
        back = read_space_of_any_format(tmp_path / again)
        assert back.variables == space.variables and allowed(back) == expected


ACTS = {
    "a": ["1", "2", "3"],
    "b": ["0", "2", "4", "-1"],
    "on": ["true", "FALSE"],
    "kind": ["x y", "z"],
}


def acts_operand(rng: random.Random) -> tuple[str, Callable[[Row], float]]:
    name, other, number = rng.choice("ab"), rng.choice("ab"), rng.randint(0, 4)
    return rng.choice(
        [
            (name, lambda row: float(row[name])),
            (str(number), lambda row: float(number)),
            (
                f"{name} + {other} * {number}",
                lambda row: float(row[name]) + float(row[other]) * number,
            ),
            (f"(-{name} - {number})", lambda row: -float(row[name]) - number),
        ]
    )


def acts_condition(rng: random.Random, depth: int = 2) -> Said:
    if depth == 0 or rng.random() < 0.2:
        if rng.random() < 0.4:
            return rng.choice(
                [
                    ("on", lambda row: row["on"] == "true"),
                    ('kind != "x y"', lambda row: row["kind"] != "x y"),
                ]
            )
        (one, first), (two, second) = acts_operand(rng), acts_operand(rng)
        sign = rng.choice(["=", "==", "!=", "<", "<=", ">", ">="])
        relation = RELATIONS[{"==": "=", "!=": "<>"}.get(sign, sign)]
        return f"{one} {sign} {two}", lambda row: relation(first(row), second(row))
    (one, left), (two, right) = acts_condition(rng, depth - 1), acts_condition(rng, depth - 1)
    return rng.choice(
        [
            (f"({one}) && !({two})", lambda row: left(row) and not right(row)),
            (f"({one}) => ({two})", lambda row: not left(row) or right(row)),
            (f"(({one})||({two}))", lambda row: left(row) or right(row)),
        ]
    )


@pytest.mark.parametrize("seed", range(60))
def test_acts_models_allow_the_rows_of_their_conditions(seed: int, tmp_path: Path) -> None:
    rng = random.Random(seed)
    conditions = [acts_condition(rng) for _ in range(rng.randint(1, 3))]
    rows = [dict(zip(ACTS, values, strict=True)) for values in product(*ACTS.values())]
    expected = {tuple(row.values()) for row in rows if all(holds(row) for _, holds in conditions)}
    kinds = {"a": " (int)", "b": "(int) ", "on": " (boolean)", "kind": ""}
    parameters = [f"{name}{kinds[name]}: {', '.join(values)}" for name, values in ACTS.items()]
    lines = [
        "-- a model",
        "[System]",
        "Name: x",
        "[Parameter]",
        *parameters,
        "[Constraint]",
        *(text for text, _ in conditions),
    ]
    (tmp_path / "model.txt").write_text("\n".join(lines))
    if not expected:
        with pytest.raises(InputError, match="no combination satisfies|contradict"):
            read_space_of_any_format(tmp_path / "model.txt")
        return
    space = read_space_of_any_format(tmp_path / "model.txt")
    assert allowed(space) == expected
    for again, kind in (
        ("again.txt", "acts"),
        ("again.xml", "acts-xml"),
        ("pict.txt", "pict"),
        ("again.yaml", "space"),
    ):
        write_model(tmp_path / again, space, kind)
        back = read_space_of_any_format(tmp_path / again)
        assert [(v.name, v.values) for v in back.variables] == [
            (v.name, v.values) for v in space.variables
        ] and allowed(back) == expected
