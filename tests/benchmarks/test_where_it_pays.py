"""When a search pays: rates and differences by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import where_it_pays


def piece(**failed: int) -> pd.DataFrame:
    """Of each version, the first of 50 tests fail."""
    keys = {"scenario": "F1star", "index": range(50), "animation": "walking", "blueprint": "W 01"}
    return pd.DataFrame(
        {
            **keys,
            **{version: (np.arange(50) < count).astype(int) for version, count in failed.items()},
        }
    )


def test_rates_by_hand() -> None:
    pieces = {
        ("uniform-100", 0): piece(base=5, random=4, adaptive=2),
        ("uniform-100", 1): piece(base=6, random=4, adaptive=4),
    }
    pieces |= {
        ("long_tailed-30", seed): piece(base=20, random=3 + 7 * seed, adaptive=7 * seed)
        for seed in range(2)
    }
    pieces["weak-100", 2] = piece(base=20, random=10, adaptive=9)
    rows = where_it_pays.answer(pieces).splitlines()
    assert rows[0] == "5 of 37 pieces are published, and the ten default studies."
    # Differences of -4 and 0 points: mean -2, standard error 2, t quantile 12.706 with one degree of freedom.
    assert rows[4] == "| `uniform` | 100 | 2 | 11.0 | 8.0 | 6.0 | -2.0 (-27.4 to +23.4) |"
    # Twice -6 points, but for rounding: nothing tells their spread.
    assert rows[5] == "| `long_tailed` | 30 | 2 | 40.0 | 13.0 | 7.0 | -6.0 |"
    assert (
        rows[6].startswith("| `long_tailed` | 100 | 10 |")
        and rows[7] == "| `weak` | 100 | 1 | 40.0 | 20.0 | 18.0 | -2.0 |"
    )
    # Four differences; only the ten published searches tell much.
    assert (
        rows[9].startswith("Smallest p of the differences, by Student's t-test: ")
        and "(`long_tailed` with 100), by Holm" in rows[9]
    )


def test_the_confirming_row_is_not_corrected() -> None:
    pieces = {
        ("after_random-100", seed): piece(base=9, random=8, adaptive=adaptive)
        for seed, adaptive in ((6, 7), (7, 6))
    }
    text = where_it_pays.answer(pieces)
    # Differences -2 and -4 points: t = 3 with one degree of freedom, p = 1 - 2 / pi * atan(3).
    assert (
        text.endswith(" That of `after_random`, asked alone, is 0.205.")
        and "(`long_tailed` with 100), by Holm" in text
    )


def test_what_is_left_of_the_bases_failures_by_hand() -> None:
    pieces = {
        ("weak-100", seed): piece(base=20, random=10, adaptive=count)
        for seed, count in enumerate((6, 7, 8))
    }
    found = where_it_pays.rates({**pieces, ("rare-300", 900): piece(base=2, random=1, adaptive=1)})
    assert list(where_it_pays.left(found["weak", 100], "random")) == [50, 50, 50]
    assert np.allclose(where_it_pays.left(found["weak", 100], "adaptive"), [30, 35, 40])
    labels = [
        [text.get_text() for text in axis.get_xticklabels()]
        for axis in where_it_pays.figure(found).axes
    ]
    assert labels == [["100"], ["rare\n4.0 %\n300 tests", "long_tailed\n18.5 %", "weak\n40.0 %"]]


def test_every_piece_has_a_command() -> None:
    plan = where_it_pays.EXPERIMENT.plan()
    assert plan.count("compose study=default") == 27 and "campaign.tests=1000" in plan
    # More tests need the weights of the piece that was just executed.
    assert plan.count("compose study=published") == 10
    assert (
        plan.index("keep strong-100 4")
        < plan.index("keep strong-more 4")
        < plan.index("keep strong-100 5")
    )


def test_more_tests_of_the_same_versions_by_hand() -> None:
    pieces = {
        (f"{base}-more", seed): piece(random=4, adaptive=1 + seed)
        for base, seed in (("strong", 0), ("strong", 1), ("after_random", 6))
    }
    rows = where_it_pays.more_tests(pieces)
    # Differences of -6 and -4 points: mean -5, standard error 1, t quantile 12.706; the third search differs by +6.
    # t = 5 with one degree of freedom: p = 1 - 2 / pi * atan(5).
    assert rows[3] == "| `strong` | 2 | 8.0 | 3.0 | -5.0 (-17.7 to +7.7) | 0.126 |"
    assert rows[4] == "| `after_random` | 1 | 8.0 | 14.0 | +6.0 | 1.000 |"
    # Mean -4 / 3, standard deviation 6.429, t = -0.359 with two degrees of freedom: p = 1 - t / sqrt(2 + t²).
    assert rows[5].startswith("| both | 3 | 8.0 | 6.7 | -1.3 (") and rows[5].endswith(") | 0.754 |")
    assert rows[6] == rows[5].replace("both", r"both, on F1\*") and len(rows) == 7
    assert where_it_pays.more_tests({}) == []
