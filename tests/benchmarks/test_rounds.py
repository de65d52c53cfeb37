"""The rounds' answer, by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import rounds

from pipeline.config.composing import compose


def counts(base: int, control: list[int], random: list[int], adaptive: list[int]) -> dict[str, int]:
    arms = zip(rounds.ARMS, (control, random, adaptive), strict=True)
    failed = {
        rounds.version(arm, after): found[after - 1]
        for arm, found in arms
        for after in rounds.ROUNDS
    }
    return {"base": base, **failed}


def left(f1: int, f2: int) -> pd.DataFrame:
    return pd.DataFrame(
        {"F1star": [f1, 0], "F2star": [f2, 1]},
        index=pd.Index(["failures", "true boxes"], name="part"),
    )


def test_rounds_by_hand() -> None:
    first = counts(30, control=[30, 31, 29], random=[20, 15, 11], adaptive=[20, 14, 10])
    second = counts(40, control=[40, 40, 41], random=[20, 15, 12], adaptive=[20, 10, 8])
    answer = rounds.tables([first, second], [left(2, 8), left(3, 5)]).splitlines()
    assert answer[0] == "2 of 3 searches."
    assert "| `base` | 30, 40 | | | |" in answer
    # Differences -10 and -12: mean -11, standard error 1, t quantile 12.706 with one degree of freedom.
    assert "| `adaptive` | 20, 20 | 14, 10 | 10, 8 | -11.0 (-23.7 to +1.7) |" in answer
    assert "`adaptive-r3` minus `random-r3`: -2.5 (-21.6 to +16.6)." in answer
    assert answer[-2:] == ["| failures | 5 | 13 | 18 |", "| true boxes | 0 | 2 | 2 |"]


def test_one_search_has_no_interval() -> None:
    only = counts(30, control=[30, 31, 29], random=[20, 15, 11], adaptive=[20, 14, 10])
    assert "| `adaptive` | 20 | 14 | 10 | -10.0 |" in rounds.tables([only], [left(2, 8)])
    assert rounds.answer({}) == "No piece is published."


def outcomes(**failed: list[int]) -> pd.DataFrame:
    tests = {"scenario": "F1star", "index": range(4), "animation": "walk", "blueprint": "a"}
    return pd.DataFrame({**tests, **failed})


def test_the_figure_joins_the_means() -> None:
    failed = {
        rounds.version(arm, after): [1, 0, 0, after % 2]
        for arm in rounds.ARMS
        for after in rounds.ROUNDS
    }
    pieces = {
        ("three", 0): outcomes(base=[1, 1, 1, 0], **failed),
        ("three", 1): outcomes(base=[1, 0, 0, 0], **failed),
    }
    (axis,) = rounds.figure(pieces).axes
    assert [np.asarray(line.get_ydata()).tolist() for line in axis.lines] == [[2, 2, 1, 2]] * 3


def test_another_detector_by_hand() -> None:
    rest = {"adaptive-r3": [1, 1, 0, 0], "random-r3": [1, 0, 0, 1]}
    plain = outcomes(base=[1, 1, 1, 0], random=[1, 1, 0, 1], adaptive=[1, 1, 1, 0], **rest)
    # The last test ended in an error, so it counts for neither.
    finer = outcomes(base=[0, 1, 0, 1], adaptive=[0, 0, 1, 1], **{"adaptive-r3": [0, 0, 1, 2]})
    again = outcomes(base=[0, 1, 0, 1], adaptive=[0, 0, 0, 1], **{"adaptive-r3": [1, 1, 1, 1]})
    lines = rounds.changed(
        {
            ("three", 0): plain,
            ("three", 1): plain,
            ("pixels", 0): again,
            ("pixels", 1): finer,
            ("small", 2): finer,
        }
    )
    assert lines.splitlines()[2:] == [
        "| `random`: other frames alone | 3, 3 | 3, 3 | 2, 2 | +0.0 | 2 of 4 |",
        # Differences 2 and -1: mean 0.5, standard error 1.5, t quantile 12.706 with one degree of freedom.
        "| 480×288 pixels | 2, 1 | 1, 1 | 4, 1 | +0.5 (-18.6 to +19.6) | 2 of 4 |",
    ]


@pytest.mark.parametrize(
    ("kind", "arms", "width"),
    [("three", {"control", "random", "adaptive"}, 320), ("pixels", {"adaptive"}, 480)],
)
def test_a_change_has_the_held_out_tests_of_the_published_setup(
    kind: str, arms: set[str], width: int
) -> None:
    config = compose("default", rounds.EXPERIMENT.overrides((kind, 2)))
    assert set(config.arms) == arms and config.simulator["camera"]["width"] == width
    assert config.comparison.seed == 62 and config.retraining.rounds == len(rounds.ROUNDS)
