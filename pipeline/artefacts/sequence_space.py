"""The parts of a space file whose points are sequences of frames.

These are `sequences`, `frames` and the rules among `variables`.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from math import inf
from typing import Any

from pipeline.artefacts.written_yaml import shown
from pipeline.core.names import nearest
from pipeline.core.sequences import Condition, Course, Order, Rule, SequenceSpace, Then, Throughout
from pipeline.core.space import Space, Variable

PARTS = ("sequences", "frames")
COLUMNS = ("time", "by")
RULES = {"first": ("first", "then", "within"), "course": ("course",), "order": ("order",)}
"""The key that tells a rule, and all keys of that rule."""
EXAMPLE = "sequences: {time: t_s, by: drive}"


def is_rule(body: Any) -> bool:
    """Whether a variable is computed from a sequence."""
    return isinstance(body, Mapping) and not RULES.keys().isdisjoint(body)


def read_columns(plain: Any) -> tuple[str, str | None]:
    """The columns of a table of frames that hold the time and, if it has several sequences, the
    name of a frame's sequence.
    """
    if not isinstance(plain, Mapping) or not isinstance(plain.get("time"), str):
        raise ValueError(
            f"sequences: expected the column of the time, as in {EXAMPLE}; got {shown(plain)}"
        )
    for key, column in plain.items():
        if key not in COLUMNS:
            raise ValueError(f"unknown key 'sequences.{key}'{nearest(str(key), COLUMNS)}")
        if not isinstance(column, str):
            raise ValueError(f"sequences.{key}: expected the name of a column, got {shown(column)}")
    return plain["time"], plain.get("by")


def sequence_space(
    space: Space,
    frames: tuple[Variable, ...],
    rules: Mapping[str, Rule],
    columns: tuple[str, str | None],
) -> SequenceSpace:
    """A space whose variables are computed by rules, or stay the same over a sequence.

    Args:
        frames: the variables of a frame alone.
    """
    # A table that has both names would be one of frames and one of points.
    if both := [variable.name for variable in frames if variable.name in rules]:
        raise ValueError(
            f"variables.{both[0]}: expected another name, because a condition of frames has this "
            "one"
        )
    steady = tuple(variable for variable in space.variables if variable.name not in rules)
    joined = Space((*frames, *steady))
    lasting = {
        variable.name: Throughout(len(frames) + place, variable.labels)
        for place, variable in enumerate(steady)
    }
    time, sequence = columns
    return SequenceSpace(
        space.variables,
        space.clauses,
        space.extras,
        frames=joined,
        rules={**rules, **lasting},
        time=time,
        sequence=sequence,
    )


def read_rule(key: str, body: Mapping[str, Any], frames: Space) -> Rule:
    """A rule over the variables of a frame; ValueError that names what is wrong."""
    kind = next(name for name in RULES if name in body)
    for name in body:
        if name not in (*RULES[kind], "weights"):
            raise ValueError(f"unknown key '{key}.{name}'{nearest(str(name), RULES[kind])}")
    if kind == "course":
        return Course(_with_cuts(f"{key}.course", body["course"], frames))
    if kind == "order":
        both = body["order"]
        if not isinstance(both, list) or len(both) != 2:
            raise ValueError(
                f"{key}.order: expected two conditions, as in [brake = on, pedestrian = visible], "
                f"got {shown(both)}"
            )
        return Order(*(_condition(f"{key}.order", text, frames) for text in both))
    within_s = inf
    if "within" in body:
        with suppress(ValueError, TypeError):
            within_s = float(body["within"])
        if not 0 < within_s < inf:
            text = shown(body["within"])
            raise ValueError(f"{key}.within: expected seconds above 0, got {text}")
    return Then(
        _condition(f"{key}.first", body["first"], frames),
        _condition(f"{key}.then", body.get("then"), frames),
        within_s,
    )


def _condition(key: str, text: Any, frames: Space) -> Condition:
    if not isinstance(text, str):
        raise ValueError(
            f"{key}: expected a condition on a frame such as rain >= 40, got {shown(text)}"
        )
    try:
        return Condition(text, frames)
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from error


def _with_cuts(key: str, name: Any, frames: Space) -> int:
    if name not in frames.names:
        raise ValueError(
            f"{key}: there is no condition of frames "
            f"{shown(name)}{nearest(str(name), frames.names)}"
        )
    index = frames.names.index(name)
    variable = frames.variables[index]
    if variable.kind == "categorical" or variable.cyclic or not variable.cuts:
        raise ValueError(
            f"{key}: expected a condition with an interval and cuts, which are what a course "
            f"passes; {name} has none"
        )
    return index
