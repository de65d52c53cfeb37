"""The answer about the default study: counts, p-values and verdicts by hand."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks import default_study
from benchmarks.default_study import Studies


def study(**failed: range) -> pd.DataFrame:
    """A published study of 20 tests. failed: the tests that a version fails."""
    keys = {"scenario": "F1star", "index": range(20), "animation": "walking", "blueprint": "W 01"}
    return pd.DataFrame(
        {
            **keys,
            **{
                version: np.isin(np.arange(20), tests).astype(int)
                for version, tests in failed.items()
            },
        }
    )


def region(seed: int, failures: int, *texts: str) -> dict[str, object]:
    conditions = json.dumps(
        [{"variable": "x", "text": text, "low": None, "high": None, "values": []} for text in texts]
    )
    return {
        "seed": seed,
        "failures": failures,
        "tests_inside": 30,
        "failures_inside": 25,
        "conditions": conditions,
    }


REGIONS = pd.DataFrame(
    [region(0, 20, "child", "rain >= 40 %"), region(0, 9, "in a skirt"), region(1, 7, "fog <= 5 %")]
)


NONE = Studies({}, pd.DataFrame(), pd.DataFrame())


def published(*studies: pd.DataFrame) -> Studies:
    """Published studies, of which the first two are timed."""
    minutes = [14.0, 16.0, np.nan][: len(studies)]
    verdicts = pd.DataFrame({"champion": "random", "minutes": minutes}, index=range(len(studies)))
    return Studies(dict(enumerate(studies)), verdicts, REGIONS)


def answer(*studies: pd.DataFrame) -> str:
    table = published(*studies)
    return default_study.answer(table, table.minutes)


BETTER = study(base=range(10), control=range(6), random=range(3), adaptive=range(1))
WORSE = study(base=range(1), control=range(1), random=range(3), adaptive=range(10))
SAME = study(base=range(2), control=range(2), random=range(2), adaptive=range(2))


def test_counts_and_p_values_by_hand() -> None:
    text = answer(BETTER, WORSE)
    prose = " ".join(text.split())
    # Nine fixes without a regression: p = 2 / 2**9; five: 2 / 2**5.
    assert "| 0 | 20 | 10 | 6 | 3 | 1 | 0.004 | 0.062 | `random` | 14.0 |" in text
    assert "| 1 | 20 | 1 | 1 | 3 | 10 | 1.000 | 1.000 | `random` | 16.0 |" in text
    assert text.startswith("2 of 10 studies are published. ")
    assert "significantly less than the base in 1 of them, and less than `control` in 0. " in prose
    # Differences -2 and +7: mean 2.5, standard error 4.5, t quantile 12.706.
    assert (
        "`adaptive` minus those of `random`: +2.5 (-54.7 to +59.7). Without seed 0: +7.0." in prose
    )
    assert "A study takes 15.0 minutes (median of 2 timed runs, 14.0 to 16.0)." in prose


def test_a_study_without_a_time_does_not_move_the_median() -> None:
    text = answer(SAME, SAME, SAME)
    assert "| `random` | not timed |" in text
    assert "(median of 2 timed runs" in " ".join(text.split())
    assert "minus those of `random`: +0.0." in " ".join(text.split())  # No spread, no interval.


def test_nothing_is_reported_without_a_study() -> None:
    assert default_study.answer(NONE, []) == "No study is published."
    assert NONE.minutes == []


def test_the_largest_region_of_each_seed_is_put_in_words() -> None:
    text = answer(SAME, SAME, SAME)
    assert "names a planted group, children or crouching people, in 1 of 3 searches." in text
    assert text.splitlines()[-3:] == [
        "| 0 | 2 | Children with rain of at least 40 % | 20 |",
        "| 1 | 1 | People with fog of at most 5 % | 7 |",
        "| 2 | 0 | none | – |",
    ]


def test_a_second_execution_is_compared_test_by_test() -> None:
    again = study(base=range(10), control=range(1, 7), random=range(4), adaptive=range(1))
    first, second = published(BETTER), published(again)
    row = default_study.repeated(first, second).splitlines()[-1]
    assert row == "| 0 | 14.0 | same | 0 | 2 | 1 | 0 |"
    others = REGIONS.assign(failures=REGIONS["failures"] + 1)
    changed = Studies(second.outcomes, second.verdicts.assign(minutes=np.nan), others)
    row = default_study.repeated(first, changed).splitlines()[-1]
    assert row == "| 0 | not timed | other | 0 | 2 | 1 | 0 |"


def test_the_headline_counts_studies_and_minutes() -> None:
    text = " ".join(default_study.headline(published(BETTER, WORSE), [9.4, 18.6]).split())
    assert text.startswith("In 1 of 2 [default studies](docs/results/default.md), `adaptive` fails")
    assert "within 9 to 19 minutes. On average, the base fails 5.5 of 20 held-out tests, " in text
    assert "`adaptive` 5.5, `random` 3.0." in text


def test_a_headline_that_no_longer_holds_is_an_error() -> None:
    """Two searches that teach more than random tests, by different numbers of failures."""
    more = study(base=range(10), control=range(6), random=range(15), adaptive=range(1))
    most = study(base=range(10), control=range(6), random=range(16), adaptive=range(1))
    with pytest.raises(SystemExit, match="write another sentence"):
        default_study.headline(published(more, most), [9.0])


def test_one_execution_is_not_published_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    commit = [
        "git",
        "-c",
        "user.name=x",
        "-c",
        "user.email=x@y",
        "commit",
        "--quiet",
        "--allow-empty",
        "-m",
        "x",
    ]
    for command in (["git", "init", "--quiet"], commit, ["git", "clone", "--quiet", ".", "0"]):
        subprocess.run(command, check=True)
    default_study.check_clone(Path("absent"), Path("again"))
    default_study.check_clone(Path("0"), Path("again"))
    (Path("0") / default_study.EXECUTED).parent.mkdir()
    (Path("0") / default_study.EXECUTED).write_text("default")
    default_study.check_clone(Path("0"), Path("default"))
    with pytest.raises(SystemExit, match="is the execution that default publishes"):
        default_study.check_clone(Path("0"), Path("again"))
    subprocess.run(commit, check=True)
    with pytest.raises(SystemExit, match="is a clone of another commit"):
        default_study.check_clone(Path("0"), Path("default"))


def test_shipped_versions_are_compared_with_their_published_outcomes() -> None:
    here = study(base=range(10), random=range(3), adaptive=range(1, 3))
    there = BETTER
    assert default_study.check(here, there).splitlines()[-2:] == [
        "| `random` | 3 | 3 | 0 |",
        "| `adaptive` | 2 | 1 | 3 |",
    ]
    with pytest.raises(SystemExit, match="expected the published held-out tests"):
        default_study.check(here.iloc[1:], there)
