"""Temporal categories: against a plain loop over frames, and through the command."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from datetime import UTC, datetime
from itertools import product
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.__main__ import main
from pipeline.artefacts.point_table import read_points
from pipeline.artefacts.space_file import read_space_file
from pipeline.core.sequences import Condition, Course, Frames, Order, Rule, Then, Throughout
from pipeline.core.space import Space, Variable

FRAME = Space(
    (
        Variable("sky", "categorical", values=("rain", "sun")),
        Variable("speed", "continuous", low=0, high=9, cuts=(3, 6)),
    )
)
RAIN, SUN, FAST = (
    Condition("sky = rain", FRAME),
    Condition("sky = sun", FRAME),
    Condition("speed >= 6", FRAME),
)
RULES: dict[str, Rule] = {
    "then": Then(RAIN, SUN, 2.0),
    "course": Course(1),
    "order": Order(SUN, FAST),
    "throughout": Throughout(1, ("low", "middle", "high")),
}
CHANGES = "changes"
SPACE = """sequences: {time: t_s, by: drive}
frames:
  sky: {values: [rain, sun]}
  speed: {interval: [0, 9], cuts: [3, 6]}
variables:
  rain_then_sun: {first: sky = rain, then: sky = sun, within: 2}
  speed_course: {course: speed, weights: {both: 2}}
  sun_or_fast: {order: [sky = sun, speed >= 6]}
  road: {values: [city, rural]}
"""
TABLE = """drive,t_s,sky,speed,road
a,0,rain,1,city
b,3,sun,7,rural
a,2,sun,4,city
b,1,rain,8,rural
c,0,sun,2,city
c,9,?,2,rural
"""


def named(rule: Rule, rows: Sequence[Sequence[int]], times: list[float]) -> str:
    """What a plain loop says of one sequence whose frames are all known."""
    frames = [
        (time, sky == 0, sky == 1, level) for time, (sky, level) in zip(times, rows, strict=True)
    ]
    if isinstance(rule, Then):
        return (
            "yes"
            if any(
                a[1] and b[2] and 0 < b[0] - a[0] <= rule.within_s for a in frames for b in frames
            )
            else "no"
        )
    if isinstance(rule, Course):
        pairs = [(a[3], b[3]) for i, a in enumerate(frames) for b in frames[i:]]
        rises, falls = any(a < b for a, b in pairs), any(a > b for a, b in pairs)
        return (
            "both" if rises and falls else "rising" if rises else "falling" if falls else "steady"
        )
    if isinstance(rule, Throughout):
        levels = {frame[3] for frame in frames}
        return rule.labels[levels.pop()] if len(levels) == 1 else CHANGES
    sun = [i for i, frame in enumerate(frames) if frame[2]]
    fast = [i for i, frame in enumerate(frames) if frame[3] == 2]
    if not sun or not fast:
        return "neither" if not sun and not fast else "first alone" if sun else "second alone"
    return (
        "together"
        if sun[0] == fast[0]
        else "first before second"
        if sun[0] < fast[0]
        else "second before first"
    )


FRAMES = st.lists(st.tuples(st.integers(-1, 1), st.integers(-1, 2)), min_size=1, max_size=4)


@settings(max_examples=150)
@given(st.lists(FRAMES, min_size=1, max_size=3), st.sampled_from(sorted(RULES)), st.integers(0, 99))
def test_a_category_is_what_every_completion_of_the_unknown_frames_has(
    sequences: list[list[tuple[int, int]]], name: str, seed: int
) -> None:
    rng, rule = np.random.default_rng(seed), RULES[name]
    times = [sorted(rng.choice(9, len(rows), replace=False) / 2) for rows in sequences]
    number = np.repeat(np.arange(len(sequences)), [len(rows) for rows in sequences])
    frames = Frames(
        np.array([row for rows in sequences for row in rows]),
        np.concatenate(times),
        number,
        len(sequences),
    )
    for outcome, rows, row_times in zip(
        rule.outcomes(frames).tolist(), sequences, times, strict=True
    ):
        choices = []
        for sky, speed in rows:
            skies = [sky] if sky >= 0 else range(2)
            choices.append(list(product(skies, [speed] if speed >= 0 else range(3))))
        possible = {named(rule, completion, row_times) for completion in product(*choices)}
        if outcome >= 0:
            assert possible == {rule.labels[outcome]}
        # Three-valued logic is sound, but misses answers on which all completions agree.
        else:
            assert any(-1 in row for row in rows) or possible == {CHANGES}


def answer(folder: Path, verb: str, table: str = TABLE, space: str = SPACE) -> tuple[int, str]:
    (folder / "space.yaml").write_text(space)
    (folder / "frames.csv").write_text(table)
    words = [
        "coverage",
        verb,
        "--space",
        str(folder / "space.yaml"),
        "--points",
        str(folder / "frames.csv"),
        "--json",
    ]
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as error:
        code = main(words)
    return code, error.getvalue().splitlines()[-1] if code == 2 else out.getvalue()


def test_sequences_of_a_table_of_frames_are_scored_and_proposed(tmp_path: Path) -> None:
    code, text = answer(tmp_path, "score")
    score = json.loads(text)
    # a: rain then sun, rising, sun alone, city. b: rain then sun, falling, fast before sun, rural.
    # c: sky and road are open at its end.
    assert code == 0 and (score["rows"], score["points"], score["partial"]) == (3, 3, 1)
    assert {cause["cause"] for cause in score["causes"]} == {
        "sequence c: road must be one of city, rural, got nothing",
    }
    _, proposed = answer(tmp_path, "propose")
    assert set(json.loads(proposed)["points"][0]) == {
        "rain_then_sun",
        "speed_course",
        "sun_or_fast",
        "road",
    }


def test_a_plan_of_sequences_is_a_table_of_points(tmp_path: Path) -> None:
    space, plan = _written(tmp_path, SPACE), tmp_path / "plan.csv"
    assert main(["coverage", "plan", "--space", str(space), "--output", str(plan)]) == 0
    assert (
        main(
            ["coverage", "verify", "--space", str(space), "--points", str(plan), "--strength", "2"]
        )
        == 0
    )


def test_an_end_of_the_time_is_within_it_however_its_difference_is_rounded() -> None:
    for start in (0.1, 0.6, 4.3, 1.8e9):
        near, far = start + 0.2, start + 0.20001
        frames = Frames(
            np.array([[0, 0], [1, 0], [0, 0], [1, 0]]),
            np.array([start, near, start, far]),
            np.array([0, 0, 1, 1]),
            2,
        )
        assert Then(RAIN, SUN, 0.2).outcomes(frames).tolist() == [1, 0]


def test_points_are_proposed_from_an_empty_table_of_frames(tmp_path: Path) -> None:
    code, text = answer(tmp_path, "propose", table=TABLE.splitlines()[0] + "\n")
    assert (
        code == 0
        and json.loads(text)["before"]["numerator"] == 0
        and json.loads(text)["count"] == 1
    )


def test_times_may_be_timestamps_and_one_table_one_sequence(tmp_path: Path) -> None:
    space = read_space_file(
        _written(
            tmp_path,
            SPACE.replace(", by: drive", "").replace("  road: {values: [city, rural]}\n", ""),
        )
    )
    stamps = [datetime(2026, 1, 1, 12, 0, second, tzinfo=UTC) for second in (5, 4)]
    pq.write_table(
        pa.table({"t_s": pa.array(stamps), "sky": ["sun", "rain"], "speed": [1.0, 5.0]}),
        tmp_path / "frames.parquet",
    )
    table = read_points(tmp_path / "frames.parquet", space)
    assert space.names_of(table.strict()) == [
        {"rain_then_sun": "yes", "speed_course": "falling", "sun_or_fast": "first alone"}
    ]
    assert table.images == ("the table",)


def _written(folder: Path, text: str) -> Path:
    (folder / "space.yaml").write_text(text)
    return folder / "space.yaml"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("time: t_s, ", ""), "sequences: expected the column of the time"),
        (("by: drive", "per: drive"), "unknown key 'sequences.per'"),
        (("sequences: {time: t_s, by: drive}\n", ""), "frames: expected sequences, too"),
        (("first: sky = rain", "first: sky = snow"), "variables.rain_then_sun.first: constraint"),
        (
            ("within: 2", "within: -2"),
            "variables.rain_then_sun.within: expected seconds above 0, got -2",
        ),
        (
            ("within: 2", "withn: 2"),
            "unknown key 'variables.rain_then_sun.withn'; did you mean 'within'?",
        ),
        (
            (", then: sky = sun", ""),
            "variables.rain_then_sun.then: expected a condition on a frame such as rain >= 40, "
            "got null",
        ),
        (
            ("course: speed", "course: sky"),
            "variables.speed_course.course: expected a condition with an interval and cuts",
        ),
        (
            ("course: speed", "course: sped"),
            "variables.speed_course.course: there is no condition of frames sped; did you mean "
            "'speed'?",
        ),
        (
            ("speed_course:", "speed:"),
            "variables.speed: expected another name, because a condition of frames has this one",
        ),
        (
            ("order: [sky = sun, speed >= 6]", "order: sky = sun"),
            "variables.sun_or_fast.order: expected two conditions",
        ),
        (("{both: 2}", "{up: 2}"), "variables.speed_course.weights: there is no category 'up'"),
        (
            (
                "frames:\n  sky: {values: [rain, sun]}\n  speed: "
                "{interval: [0, 9], cuts: [3, 6]}\n",
                "",
            ),
            "a rule needs the conditions of a frame",
        ),
    ],
)
def test_a_wrong_rule_is_named(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    code, error = answer(tmp_path, "score", space=SPACE.replace(*change, 1))
    assert code == 2 and message in error


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("drive,t_s", "drive,time"), "there is none for t_s"),
        (
            ("a,2,sun", "a,soon,sun"),
            "row 3: expected a time, as a number of seconds or a timestamp",
        ),
        (("a,2,sun", "a,0,sun"), "two frames of a have the time 0"),
        (("a,2,sun", ",2,sun"), "row 3: expected a sequence in column drive, got nothing"),
    ],
)
def test_a_wrong_table_of_frames_is_named(
    change: tuple[str, str], message: str, tmp_path: Path
) -> None:
    code, error = answer(tmp_path, "score", table=TABLE.replace(*change, 1))
    assert code == 2 and message in error
