"""The rounds' answer, by hand."""

from __future__ import annotations

import pandas as pd
import rounds


def counts(base: int, control: list[int], random: list[int], adaptive: list[int]) -> dict[str, int]:
    arms = zip(rounds.ARMS, (control, random, adaptive), strict=True)
    failed = {rounds.version(arm, after): found[after - 1] for arm, found in arms for after in rounds.ROUNDS}
    return {"base": base, **failed}


def left(f1: int, f2: int) -> pd.DataFrame:
    return pd.DataFrame({"F1star": [f1, 0], "F2star": [f2, 1]}, index=pd.Index(["failures", "true boxes"], name="part"))


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
