"""Shards of a campaign give the rows of the whole campaign, bit for bit, and only strategies that
do not learn have shards."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest

from pipeline.artefacts import tables
from pipeline.config.composing import compose
from pipeline.core.samplers.forest import ForestSampler
from pipeline.core.samplers.random import RandomSampler
from pipeline.core.shards import Shard
from pipeline.core.space import Floats
from pipeline.testing import check_sampler
from pipeline.workflow.jobs import Jobs, Target, step_names
from pipeline.workflow.stamping import Stamps
from tests.campaigns import analytic_study, folder, key
from tests.spaces import SMALL
from tests.studies import ROOT, StudyFolder

COUNT = 3
"""The shards begin and end inside batches."""


def sharded(root: Path, strategy: str, *overrides: str) -> tuple[StudyFolder, int]:
    """A study whose campaign of a strategy was executed in shards, last shard first, and the exit
    code of joining them."""
    study = analytic_study(root, f"campaign.shards={COUNT}", *overrides)
    for number in reversed(range(COUNT)):
        assert study.run("shard", shard=Shard(number, COUNT), **key(strategy)) == 0
    return study, study.run("campaign", **key(strategy))


def joined(root: Path, strategy: str, *overrides: str) -> pd.DataFrame:
    """The tests of a campaign that was executed in shards; its tables are those of the whole
    campaign."""
    whole = analytic_study(root / "whole", *overrides)
    assert whole.run("campaign", **key(strategy)) == 0
    parts, code = sharded(root / "parts", strategy, *overrides)
    assert code == 0
    for name in ("tests", "signals", "detections", "frames"):
        first, other = (folder(study, strategy) / f"{name}.parquet" for study in (whole, parts))
        assert first.read_bytes() == other.read_bytes(), name
    tests = tables.read_tests(folder(parts, strategy) / "tests.parquet")
    assert list(
        tables.read_timings(folder(parts, strategy) / "timings.parquet")["test_id"]
    ) == list(tests["test_id"])
    return tests


@pytest.mark.parametrize("strategy", ["random", "pairwise", "coverage"])
def test_shards_give_the_bytes_of_the_whole_campaign(tmp_path: Path, strategy: str) -> None:
    assert len(joined(tmp_path, strategy)) == 24


def test_a_shard_may_end_in_errors_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    fragile = "simulator._target_=tests.campaigns.Fragile"
    assert list(joined(tmp_path, "random", fragile, f"campaign.tests={COUNT}")["status"]) == [
        "ok",
        "ok",
        "error",
    ]


@dataclass
class Finite(RandomSampler):
    """Asks for `total` tests."""

    total: int

    def ask(self) -> Floats:
        return super().ask()[: self.total - len(self._points)]


FINITE = [
    "campaign.tests=9",
    "samplers.random.batch_size=2",
    "samplers.random._target_=tests.workflow.test_shards.Finite",
]


def test_a_shard_may_lie_beyond_the_last_test_of_its_strategy(tmp_path: Path) -> None:
    assert len(joined(tmp_path, "random", *FINITE, "+samplers.random.total=4")) == 4


FRUITLESS = {
    "errors": (
        ["campaign.tests=3", "detector._target_=tests.faults.hostile.Fails"],
        1,
        "all 3 tests ended in an error",
    ),
    "no tests": (
        [*FINITE, "+samplers.random.total=0"],
        2,
        "expected at least one test, the strategy asks for none",
    ),
}


@pytest.mark.parametrize(("overrides", "code", "reason"), FRUITLESS.values(), ids=FRUITLESS.keys())
def test_shards_without_a_valid_test_are_no_campaign_and_are_executed_again(
    overrides: list[str],
    code: int,
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    parts, ended = sharded(tmp_path / "parts", "random", *overrides)
    assert (
        ended == code
        and f"blindspot step campaign: F1, random, base, seed 3: {reason}"
        in capsys.readouterr().err
    )
    assert list((parts / "shards").rglob("*.parquet")) and not list(
        (parts / "shards").rglob("*.stamp")
    )
    whole = analytic_study(tmp_path / "whole", *overrides)
    assert whole.run("campaign", **key("random")) == code
    assert reason in capsys.readouterr().err


def test_a_missing_shard_is_an_error_that_names_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = analytic_study(tmp_path, "campaign.shards=2")
    assert study.run("campaign", **key("random")) == 2
    assert "shards/campaigns/F1/random/base/3/1of2" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("strategy", "shard", "message"),
    [
        ("random", "9of3", "shard: a shard must be 1 to 3 of 3, got 9of3"),
        ("mixed", "1of3", "strategy: mixed learns from all tests"),
    ],
)
def test_a_shard_that_is_no_part_is_refused(
    tmp_path: Path, strategy: str, shard: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    study = analytic_study(tmp_path, f"campaign.shards={COUNT}")
    assert study.run("shard", shard=shard, **key(strategy)) == 2
    assert message in capsys.readouterr().err


def test_the_number_of_shards_makes_only_tracking_out_of_date() -> None:
    first, many = (
        stamps(Jobs(compose("smoke", [f"campaign.shards={shards}"]), step_names()))
        for shards in (1, 16)
    )
    # Tracking records the whole config.
    assert {job.step for job in first if first[job] != many[job]} == {"track"}
    assert {job.step for job in many if job not in first} == {"shard"}


def stamps(jobs: Jobs) -> dict[Target, str]:
    today = Stamps(jobs)
    return {job: today.stamp(job.step, dict(job.wildcards)) for job, _ in jobs.in_order()}


def test_strategies_that_learn_have_no_shards_and_no_shard_is_empty() -> None:
    jobs = Jobs(compose("smoke", ["campaign.shards=16"]), step_names())
    shared = [job for job, _ in jobs.in_order() if job.step == "shard"]
    assert {dict(job.wildcards)["strategy"] for job in shared} == {"random", "pairwise"}
    # 12 tests of each search and 8 of each held-out sequence.
    assert _count(shared, kind="campaigns") == 2 * 12 and _count(
        shared, kind="held_out"
    ) == 8 * len(jobs.config.versions)


def _count(jobs: list[Target], kind: str) -> int:
    return sum(dict(job.wildcards)["kind"] == kind for job in jobs)


@pytest.mark.parametrize(("tests", "count"), [(10_000, 100), (7, 3), (5, 5), (3, 10), (2, 2)])
def test_shards_cover_each_test_once_and_evenly(tests: int, count: int) -> None:
    parts = [shard.tests(tests) for shard in Shard.of(tests, count)]
    assert [index for part in parts for index in part] == list(range(tests))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1 and all(parts)


@pytest.mark.parametrize("name", ["0of3", "4of3", "1of0", "1-3", ""])
def test_a_foreign_name_is_no_shard(name: str) -> None:
    with pytest.raises(ValueError, match="shard"):
        Shard.named(name)


def test_one_shard_is_the_whole_campaign() -> None:
    assert Shard.of(100, 1) == Shard.of(1, 100) == []
    assert Shard.named("3of16") == Shard(2, 16)


def test_the_checker_refuses_a_strategy_that_learns_and_denies_it() -> None:
    class Denies(ForestSampler):
        learns = False

    with pytest.raises(AssertionError, match="`learns` is False must ignore results"):
        check_sampler(lambda: Denies(SMALL, 5, batch_size=8), SMALL, batches=6)
