"""The answer about the default study: counts, p-values and verdicts by hand."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import default_study
import numpy as np
import pandas as pd
import pytest
from default_study import Studies


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


def answer(*studies: pd.DataFrame) -> str:
    verdicts = pd.DataFrame(
        {"champion": "random", "minutes": [14.0, 16.0, np.nan][: len(studies)]},
        index=range(len(studies)),
    )
    found = Studies(dict(enumerate(studies)), verdicts, REGIONS)
    return default_study.answer(found, default_study.timed_minutes(found, NONE))


def test_counts_and_p_values_by_hand() -> None:
    better = study(base=range(10), control=range(6), random=range(3), adaptive=range(1))
    worse = study(base=range(1), control=range(1), random=range(3), adaptive=range(10))
    text = answer(better, worse)
    said = " ".join(text.split())
    # Nine fixes without a regression: p = 2 / 2**9; five: 2 / 2**5.
    assert "| 0 | 20 | 10 | 6 | 3 | 1 | 0.004 | 0.062 | `random` | 14.0 |" in text
    assert "| 1 | 20 | 1 | 1 | 3 | 10 | 1.000 | 1.000 | `random` | 16.0 |" in text
    assert text.startswith("2 of 10 studies are published. ")
    assert (
        "fails significantly less than the base in 1 of them, and less than `control` in 0. "
        in said
    )
    # Differences -2 and +7: mean 2.5, standard error 4.5, t quantile 12.706 with one degree of freedom.
    assert (
        "Failures of `adaptive` minus those of `random`: +2.5 (-54.7 to +59.7). Without seed 0: +7.0. A study takes 15.0 minutes "
        in said
    )
    assert "minutes (median of 2 timed runs, 14.0 to 16.0)." in said


def test_a_study_without_a_time_does_not_move_the_median() -> None:
    same = study(base=range(2), control=range(2), random=range(2), adaptive=range(2))
    text = answer(same, same, same)
    assert "| `random` | not timed |" in text and "(median of 2 timed runs" in " ".join(
        text.split()
    )
    assert "minus those of `random`: +0.0." in " ".join(text.split()), (
        "studies that differ equally tell no spread"
    )


def test_nothing_is_said_without_a_study() -> None:
    assert default_study.answer(NONE, []) == "No study is published."


def test_the_largest_region_of_each_seed_is_put_in_words() -> None:
    same = study(base=range(2), control=range(2), random=range(2), adaptive=range(2))
    text = answer(same, same, same)
    assert "names a planted group, children or crouching people, in 1 of 3 searches." in " ".join(
        text.split()
    )
    assert text.splitlines()[-3:] == [
        "| 0 | 2 | Children with rain of at least 40 % | 20 | 30 | 25 |",
        "| 1 | 1 | People with fog of at most 5 % | 7 | 30 | 25 |",
        "| 2 | 0 | none | – | – | – |",
    ]


def test_outcomes_of_another_machine_are_compared_test_by_test() -> None:
    first = study(base=range(10), control=range(6), random=range(3), adaptive=range(1))
    again = study(base=range(10), control=range(1, 7), random=range(4), adaptive=range(1))
    verdicts = pd.DataFrame({"champion": ["adaptive"], "minutes": [18.8]}, index=[0])
    others = REGIONS.assign(failures=REGIONS["failures"] + 1)
    studies = Studies({0: first}, verdicts, REGIONS)
    text = "\n".join(default_study.repeated(studies, Studies({0: again}, verdicts, REGIONS)))
    assert "in 18.8 minutes. The searches found the same failure regions." in text
    assert (
        "| `base` | 10 | 10 | 0 |" in text
        and "| `control` | 6 | 6 | 2 |" in text
        and "| `random` | 3 | 4 | 1 |" in text
    )
    untimed = default_study.repeated(
        studies, Studies({0: again}, verdicts.assign(minutes=np.nan), REGIONS)
    )
    assert "Seed 0 once more. The searches" in " ".join(untimed)
    assert "found other failure regions" in " ".join(
        default_study.repeated(studies, Studies({0: again}, verdicts, others))
    )
    assert not default_study.repeated(studies, NONE)


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
    there = study(base=range(10), control=range(6), random=range(3), adaptive=range(1))
    assert default_study.check(here, there).splitlines()[-2:] == [
        "| `random` | 3 | 3 | 0 |",
        "| `adaptive` | 2 | 1 | 3 |",
    ]
    with pytest.raises(SystemExit, match="expected the published held-out tests"):
        default_study.check(here.iloc[1:], there)
