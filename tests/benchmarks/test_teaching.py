"""The tables about searches that teach: counts and differences by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import teaching


def piece(**failed: int) -> pd.DataFrame:
    keys = {"scenario": "F1star", "index": range(50), "animation": "walking", "blueprint": "W 01"}
    return pd.DataFrame(
        {
            **keys,
            **{version: (np.arange(50) < count).astype(int) for version, count in failed.items()},
        }
    )


def shares(random: int, half: int) -> pd.DataFrame:
    return piece(base=30, control=31, random=random, share75=9, adaptive=half, share25=8, forest=12)


def test_mixtures_and_choices_are_compared_with_random_tests() -> None:
    pieces = {
        ("shares", 0): shares(10, 8),
        ("shares", 1): shares(12, 6),
        ("unsure", 1): piece(base=30, control=31, random=1, adaptive=13),
    }
    text = teaching.answer(pieces)
    assert text.startswith("2 of 3 searches.")
    # Differences -2 and -6: mean -4, standard error 2, t quantile 12.706 with one degree of freedom.
    assert (
        "| 50 % | 8, 6 | 7.0 | -4.0 (-29.4 to +21.4) |" in text
        and "| all alike | 8, 6 | 7.0 | +0.0 | -4.0 (-29.4 to +21.4) |" in text
    )
    # Differences -2 and -4: t = 3 with one degree of freedom, p = 1 - 2 / pi * atan(3); one of four mixtures.
    assert "by Student's t-test: 0.205 (25 %), by Holm 0.819." in text
    assert "by Student's t-test: 1.000 (75 %), by Holm 1.000." in teaching.answer(
        {("shares", 0): shares(10, 8)}
    )
    assert "| 100 % | 10, 12 | 11.0 | +0.0 |" in text
    # Against the versions of the same search that learnt from all frames alike.
    assert (
        "| more where unsure | –, 13 | 13.0 | +7.0 | +1.0 |" in text
        and "more where missed" not in text
    )
    assert "other searches" not in text


def test_other_searches_are_compared_with_the_random_tests_of_their_pieces() -> None:
    searches = {
        ("searches", seed): piece(base=30, random=10, near=near, kinds=10, transfer=11)
        for seed, near in ((0, 8), (2, 6))
    }
    text = teaching.answer({("shares", 0): shares(20, 8), **searches})
    assert (
        "2 of 3 other searches." in text
        and "| near misses, too | 8, 6 | 7.0 | -3.0 (-15.7 to +9.7) |" in text
    )
    # Differences -2 and -4, as above; one of three searches.
    assert (
        "Smallest p of a search against random tests, by Student's t-test: 0.205 (near misses, too), by Holm 0.614."
        in text
    )


def test_every_piece_has_a_command() -> None:
    plan = teaching.EXPERIMENT.plan()
    assert (
        plan.count("python -m pipeline compose study=teaching")
        == len(teaching.KINDS) * len(teaching.SEEDS)
        == 18
    )
    assert "retraining.selection=missed" in plan and "retraining.selection=shares" not in plan
