"""The retraining experiment's answer: counts, intervals and verdicts by hand."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import outcomes
import pandas as pd
import pieces
import pytest
import retraining


@pytest.fixture(autouse=True)
def no_published_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Repairs are read from where pieces publish them."""
    monkeypatch.setattr(pieces, "RESULTS", tmp_path / "results")


def piece(tests: int = 100, **failed: int) -> pd.DataFrame:
    """A published piece: of each version, the first tests fail."""
    keys = {
        "scenario": "F1star",
        "index": range(tests),
        "animation": "walking",
        "blueprint": "W 01",
    }
    return pd.DataFrame(
        {
            **keys,
            **{
                version: (np.arange(tests) < count).astype(int) for version, count in failed.items()
            },
        }
    )


def long_tailed(
    adaptive: list[int], random: list[int], base: int = 50
) -> dict[tuple[str, int], pd.DataFrame]:
    pairs = enumerate(zip(adaptive, random, strict=True))
    return {
        ("long_tailed", seed): piece(base=base, random=other, adaptive=count)
        for seed, (count, other) in pairs
    }


def rows(answer: str, version: str) -> list[list[str]]:
    """The cells of a version's row in the table of each base."""
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in answer.splitlines()
        if line.startswith(f"| `{version}`")
    ]


def row(answer: str, version: str) -> list[str]:
    (cells,) = rows(answer, version)
    return cells


def test_means_and_intervals_by_hand() -> None:
    answer = retraining.answer(long_tailed(adaptive=[10, 12, 14], random=[20, 20, 20]))
    assert (
        "3 of 10 pieces are published." in answer
        and "3 searches, 100 held-out tests each" in answer
    )
    # Differences -10, -8, -6: mean -8, standard error 2 / sqrt(3), t quantile 4.303 with two degrees of freedom.
    assert row(answer, "random") == [
        "`random`",
        "20, 20, 20",
        "20.0",
        "-8.0 (-13.0 to -3.0)",
        "0.020",
        "fewer",
    ]
    assert row(answer, "adaptive")[2] == "12.0 (7.0 to 17.0)"


def test_the_figure_has_a_dot_for_each_search() -> None:
    drawn, empty = retraining.figure(long_tailed(adaptive=[10, 12, 14], random=[20, 20, 20])).axes
    assert [text.get_text() for text in drawn.get_xticklabels()] == ["base", "random", "adaptive"]
    offsets = [np.asarray(each.get_offsets()) for each in drawn.collections]
    dots = [each[:, 1].tolist() for each in offsets if len(each) == 3]
    assert dots == [[50, 50, 50], [20, 20, 20], [10, 12, 14]] and not empty.collections


def test_equal_within_a_tenth_of_the_base_is_equivalent() -> None:
    close = retraining.answer(long_tailed(adaptive=[10, 11, 10, 9], random=[10, 10, 11, 10]))
    apart = retraining.answer(long_tailed(adaptive=[1, 20, 10, 9], random=[10, 10, 11, 10]))
    assert row(close, "random")[-1] == "equivalent" and row(apart, "random")[-1] == "not shown"


def test_one_search_shows_nothing() -> None:
    assert row(retraining.answer(long_tailed(adaptive=[0], random=[50])), "random")[-2:] == [
        "1.000",
        "not shown",
    ]


@pytest.mark.parametrize("ahead", [-5, 0, 1])
def test_equal_differences_have_no_spread_and_show_nothing(ahead: int) -> None:
    with warnings.catch_warnings(action="error"):  # SciPy warns of a test without spread.
        answer = retraining.answer(long_tailed(adaptive=[10 + ahead, 20 + ahead], random=[10, 20]))
    assert row(answer, "random")[-3:] == [f"{ahead:.1f}", "1.000", "not shown"]


def test_an_equivalence_is_judged_alone() -> None:
    """As the docstring says: Holm's method leaves the interval as it is."""
    searches = long_tailed(adaptive=[10, 11, 10, 9], random=[50, 51, 50, 50])
    for table, count in zip(searches.values(), [11, 10, 10, 9], strict=True):
        table["control"] = (np.arange(100) < count).astype(int)
    alone = row(retraining.answer(searches), "control")
    searches |= {("uniform", seed): table for (_, seed), table in searches.items()}
    assert (
        rows(retraining.answer(searches), "control") == [alone, alone] and alone[-1] == "equivalent"
    )


def test_a_test_with_an_error_counts_for_no_version() -> None:
    searches = long_tailed(adaptive=[10, 12], random=[20, 20])
    for table in searches.values():
        table.loc[0, "base"] = outcomes.ERROR
    assert row(retraining.answer(searches), "adaptive")[1] == "9, 11"


def test_secondary_questions_share_their_alpha() -> None:
    """Holm: two p-values of 0.04 are 0.08 each; the primary question stays as it is."""
    contrasts = [
        retraining.Contrast(-1.0, -2.0, -0.1, 0.0, p_value) for p_value in (0.04, 0.04, 0.001)
    ]
    retraining._adjust(contrasts)
    assert [round(each.p_value, 6) for each in contrasts] == [0.08, 0.08, 0.003]
    # The largest of three secondary p-values is left as it is, the middle one doubles.
    alone = long_tailed(adaptive=[10, 14, 11], random=[50, 51, 50], base=20)
    both = {**alone, **{("uniform", seed): table for (_, seed), table in alone.items()}}
    assert [cells[-2] for cells in rows(retraining.answer(alone), "base")] == ["0.020"]
    assert [cells[-2] for cells in rows(retraining.answer(both), "base")] == ["0.040", "0.040"]


def test_a_failure_stays_if_nearly_all_versions_that_learnt_from_tests_have_it() -> None:
    searches = long_tailed(adaptive=[10, 12, 14, 10, 10], random=[9, 20, 20, 20, 20])
    for table in searches.values():
        table["control"] = table["base"]  # Learnt from no tests.
        table["index"] += 1
        table.loc[50:, "scenario"] = "F2star"
        table.loc[50:, "adaptive"] = 1
    searches["long_tailed", 0].loc[0, "base"] = (
        outcomes.ERROR
    )  # Counts for no version of this search.
    cells = {
        line.split(" | ")[0]: line.split(" | ")[1:]
        for line in retraining.answer(searches).splitlines()
        if line.startswith("| ")
    }
    assert cells["| failures"] == ["F1\\*", "F2\\*", "all |"]
    assert cells["| mean of `base`"] == ["50.0", "0.0", "50.0 |"]
    # Ten versions: all have the tests 0 to 8, nine of them test 9; the mean of `adaptive` is that of 10, 12, 14, 10 and 10.
    assert cells["| left by 90 % of the versions that learnt from tests"] == ["10", "0", "10 |"]
    assert cells["| mean of `adaptive`"] == ["11.2", "50.0", "61.2 |"]


def test_repairs_are_summed_over_the_pieces_that_publish_them() -> None:
    searches = long_tailed(adaptive=[10, 12, 14], random=[20, 20, 20])
    assert "replaced" not in retraining.answer(searches)
    retraining.EXPERIMENT.folder.mkdir(parents=True)
    for seed in (0, 2):
        repaired = pd.DataFrame(
            {"F1star": [10 + seed, 4], "F2star": [1, 0]},
            index=pd.Index(["failures", "true boxes"], name="part"),
        )
        repaired.to_csv(retraining.EXPERIMENT.left(("long_tailed", seed)))
    lines = retraining.answer(searches).splitlines()
    assert (
        "Failures repaired when [one part of the loop](rounds.md#setup) is replaced, seeds 0, 2:"
        in lines
    )
    assert lines[-2:] == ["| failures | 22 | 2 | 24 |", "| true boxes | 8 | 0 | 8 |"]
