"""Shards of a campaign give the rows of the whole campaign, bit for bit, and only strategies that do not learn have shards."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.artefacts import tables
from pipeline.config.composing import compose
from pipeline.core.samplers.forest import ForestSampler
from pipeline.core.shards import Shard
from pipeline.testing import check_sampler
from pipeline.workflow.jobs import Jobs, Target, step_names
from pipeline.workflow.stamping import Stamps
from tests.spaces import SMALL
from tests.studies import StudyFolder
from tests.workflow.test_campaign import analytic_study, folder, key

COUNT = 3
"""The shards begin and end inside batches."""


def sharded(root: Path, strategy: str) -> StudyFolder:
    """A study whose campaign of a strategy was executed in shards, last shard first."""
    study = analytic_study(root, f"campaign.shards={COUNT}")
    for number in reversed(range(COUNT)):
        assert study.run("shard", shard=Shard(number, COUNT), **key(strategy)) == 0
    assert study.run("campaign", **key(strategy)) == 0
    return study


@pytest.mark.parametrize("strategy", ["random", "pairwise", "coverage"])
def test_shards_give_the_bytes_of_the_whole_campaign(tmp_path: Path, strategy: str) -> None:
    whole = analytic_study(tmp_path / "whole")
    assert whole.run("campaign", **key(strategy)) == 0
    parts = sharded(tmp_path / "parts", strategy)
    for name in ("tests", "signals", "detections", "frames"):
        one, other = (folder(study, strategy) / f"{name}.parquet" for study in (whole, parts))
        assert one.read_bytes() == other.read_bytes(), name
    named = tables.read_tests(folder(parts, strategy) / "tests.parquet")["test_id"]
    assert list(tables.read_timings(folder(parts, strategy) / "timings.parquet")["test_id"]) == list(named) and len(named) == 24


def test_a_missing_shard_is_an_error_that_names_its_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = analytic_study(tmp_path, "campaign.shards=2")
    assert study.run("campaign", **key("random")) == 2
    assert "shards/campaigns/F1/random/base/3/1of2" in capsys.readouterr().err


def test_the_number_of_shards_makes_only_tracking_out_of_date() -> None:
    one, many = (stamps(Jobs(compose("smoke", [f"campaign.shards={shards}"]), step_names())) for shards in (1, 16))
    # Tracking records the whole config.
    assert {job.step for job in one if one[job] != many[job]} == {"track"}
    assert {job.step for job in many if job not in one} == {"shard"}


def stamps(jobs: Jobs) -> dict[Target, str]:
    today = Stamps(jobs)
    return {job: today.stamp(job.step, dict(job.wildcards)) for job, _ in jobs.in_order()}


def test_strategies_that_learn_have_no_shards_and_no_shard_is_empty() -> None:
    jobs = Jobs(compose("smoke", ["campaign.shards=16"]), step_names())
    shared = [job for job, _ in jobs.in_order() if job.step == "shard"]
    assert {dict(job.wildcards)["strategy"] for job in shared} == {"random", "pairwise"}
    # 12 tests of each search and 8 of each held-out sequence.
    assert _count(shared, kind="campaigns") == 2 * 12 and _count(shared, kind="held_out") == 8 * len(jobs.config.versions)


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
