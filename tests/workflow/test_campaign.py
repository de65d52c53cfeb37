"""Campaigns give the same bytes for any number of workers and any number of kills."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.artefacts import tables
from pipeline.artefacts.files import write_sealed
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.scenario_space import read_space
from pipeline.config.composing import PARAMS, compose, load
from pipeline.core import kpi
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.core.identity import CampaignId
from pipeline.core.measures import kinds_of
from pipeline.core.names import count_of
from pipeline.execution import workers
from pipeline.execution.campaign import CampaignPlan, sampler_seed
from pipeline.execution.workers import Setup
from pipeline.progress import Progress
from tests.campaigns import MODEL, analytic_study, folder, journal, key, same
from tests.spaces import SMALL
from tests.strategies import strategies
from tests.studies import ROOT, StudyFolder, arguments


def test_two_workers_give_the_same_bytes_as_one(one_worker: StudyFolder, tmp_path: Path) -> None:
    two = analytic_study(tmp_path)
    assert two.run("campaign", threads=2, **key()) == 0
    assert same(folder(one_worker), folder(two))
    assert not journal(two).exists()


def test_a_campaign_with_earlier_tests_chooses_other_tests(tmp_path: Path) -> None:
    taught, again, alone = (
        analytic_study(tmp_path / name, f"campaign.transfer={knowledge}")
        for name, knowledge in TAUGHT.items()
    )
    for study, threads in ((taught, 2), (again, 1), (alone, 1)):
        for scenario in ("F1", "F2"):
            assert study.run("campaign", threads=threads, **key(scenario=scenario)) == 0
    assert same(folder(taught, scenario="F2"), folder(again, scenario="F2"))
    assert same(folder(taught), folder(alone)) and not same(
        folder(taught, scenario="F2"), folder(alone, scenario="F2")
    )


TAUGHT = {"taught": "[mixed]", "again": "[mixed]", "alone": "[]"}


def test_scenarios_with_one_seed_share_no_test(tmp_path: Path) -> None:
    study, fog = analytic_study(tmp_path), {}
    for scenario, kind in {"F1": "campaigns", "F1star": "held_out"}.items():
        assert study.run("campaign", threads=2, **key("random", scenario, kind)) == 0
        fog[scenario] = set(
            tables.read_tests(folder(study, "random", scenario, kind) / "tests.parquet")["fog"]
        )
    assert (len(fog["F1"]), len(fog["F1star"])) == (24, 8) and not fog["F1"] & fog["F1star"]


def first_batch(campaign: CampaignId, frozen: bool = False) -> set[bytes]:
    sampler = strategies()[campaign.strategy](SMALL, sampler_seed(campaign, frozen), batch_size=8)
    return {point.tobytes() for point in sampler.ask()}


def test_campaigns_that_differ_in_any_name_share_no_test_of_the_first_batch() -> None:
    first = CampaignId("F1", "random", "base", 3)
    changed: list[dict[str, Any]] = [
        {},
        {"scenario": "F2"},
        {"strategy": "mixed"},
        {"version": "adaptive"},
        {"seed": 4},
    ]
    batches = [first_batch(replace(first, **names)) for names in changed]
    assert len(set.union(*batches)) == sum(map(len, batches)) == 40


def test_versions_share_the_held_out_sequence_and_scenarios_do_not() -> None:
    base = CampaignId("F1star", "pairwise", "base", 0)
    assert first_batch(base, frozen=True) == first_batch(
        replace(base, version="adaptive"), frozen=True
    )
    assert not first_batch(base, frozen=True) & first_batch(
        replace(base, scenario="F2star"), frozen=True
    )


def test_progress_counts_every_failure_as_it_comes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[tuple[int, str]] = []
    monkeypatch.setattr(
        Progress, "__call__", lambda self, done, total, text="": shown.append((done, text))
    )
    study = analytic_study(tmp_path, "detector._target_=pipeline.detectors.scripted.BlindDetector")
    shown.clear()
    assert study.run("campaign", **key()) == 0
    tests = tables.read_tests(folder(study) / "tests.parquet").sort_values("index")
    failed, space = tests["failure"].cumsum(), read_space(study / "space/F1.json")[1]
    assert failed.iloc[-1] > 0
    kinds = kinds_of(space, encode_tests(tests[tests["failure"]], space))
    assert shown[-1][1].endswith(f", {count_of(kinds, 'kind')}")
    # One worker executes the tests in order.
    assert [(done, text.split(" (")[0]) for done, text in shown] == [
        (done, count_of(count, "failure")) for done, count in enumerate(failed, 1)
    ]


def finished(study: StudyFolder) -> int:
    return len(list(journal(study).glob("*.npz")))


def test_a_campaign_killed_three_times_gives_the_same_bytes(
    one_worker: StudyFolder, tmp_path: Path
) -> None:
    study = analytic_study(tmp_path, "simulator._target_=tests.campaigns.Slow")
    command = [sys.executable, "-m", "pipeline", *arguments("campaign", 2, **key())]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    for _ in range(3):
        before = finished(study)
        process = subprocess.Popen(
            command, cwd=tmp_path, env=environment, stderr=subprocess.DEVNULL
        )
        while process.poll() is None and finished(study) < before + 3:
            time.sleep(0.01)
        assert process.poll() is None, "the campaign ended before it could be killed"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        assert not (folder(study) / "tests.parquet").exists()
    subprocess.run(command, cwd=tmp_path, env=environment, check=True, stderr=subprocess.DEVNULL)
    assert same(folder(one_worker), folder(study))


def test_rows_follow_from_the_signals(one_worker: StudyFolder) -> None:
    tests, signals = (
        read(folder(one_worker) / f"{name}.parquet") for name, read in READERS.items()
    )
    assert len(tests) == 24
    for row in tests.itertuples():
        steps = signals[signals["test_id"] == row.test_id]
        again = kpi.evaluate({name: steps[name].to_numpy() for name in steps.columns}, 0.1)
        assert (again.adj_ttc_s, again.failure, again.failure_mode) == (
            row.adj_ttc_s,
            row.failure,
            row.failure_mode,
        )
    assert set(tables.read_timings(folder(one_worker) / "timings.parquet")["test_id"]) == set(
        tests["test_id"]
    )


def test_a_batch_is_what_the_strategy_asked_for_at_once(tmp_path: Path) -> None:
    study = analytic_study(tmp_path, "samplers.random.batch_size=9")
    assert study.run("campaign", **key("random")) == 0
    assert (
        list(tables.read_tests(folder(study, "random") / "tests.parquet")["batch"])
        == [0] * 9 + [1] * 9 + [2] * 6
    )


READERS = {"tests": tables.read_tests, "signals": tables.read_signals}


def test_units_are_in_the_file(one_worker: StudyFolder) -> None:
    import pyarrow.parquet as pq

    schema = pq.read_schema(folder(one_worker) / "tests.parquet")
    assert schema.field("fog").metadata == {b"unit": b"%"}
    assert schema.field("impact_speed_mps").metadata == {b"unit": b"m/s"}
    assert read_space(one_worker / "space/F1.json")[1].names == tuple(schema.names[-8:])


def test_an_outcome_depends_on_everything_that_executes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("one", "two"):
        (tmp_path / name).write_text(name)
    config, other = (
        compose("smoke", ["simulator=analytic", "detector=oracle", f"aeb.brakes_from={score}"])
        for score in (0.3, 0.4)
    )
    setup = Setup(
        config.simulator,
        config.scenarios["F1"],
        config.detector,
        tmp_path / "one",
        config.car,
        config.limits,
    )
    others: dict[str, Any] = {
        "simulator": {**config.simulator, "more": 1},
        "scenario": config.scenarios["F2"],
        "detector": {**config.detector, "more": 1},
        "model": tmp_path / "two",
        "car": other.car,
        "limits": config.limits.model_copy(update={"frame_s": 1}),
        "keep_every": 3,
    }
    assert set(others) == {field.name for field in fields(Setup)}
    identities = {
        setup.identity,
        *(replace(setup, **{name: value}).identity for name, value in others.items()),
    }
    monkeypatch.setattr(workers, "program_sha256", lambda: "other code")
    assert len(identities | {setup.identity}) == 1 + len(others) + 1


def test_a_journal_of_another_campaign_is_discarded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = analytic_study(tmp_path)
    write_sealed(journal(study) / "identity", b"of another campaign")
    (journal(study) / "000000.npz").write_bytes(b"foreign")
    assert study.run("campaign", **key()) == 0
    assert (
        "the journal belonged to another configuration, model or code and was discarded"
        in capsys.readouterr().err
    )


def test_a_journal_at_another_failure_threshold_is_discarded(tmp_path: Path) -> None:
    study = analytic_study(tmp_path)
    config = load(study.root / PARAMS)
    setup = Setup.of(config, "F1", study / MODEL)
    space, strategy = config.space("F1"), compose("thesis", []).samplers["evolutionary"]
    assert (
        "failure_threshold_s" not in strategy
    )  # It is told which tests failed, so its tests depend on the threshold all the same.
    plans = [
        CampaignPlan(
            CampaignId("F1", "evolutionary", "base", 3), space, 24, threshold_s, strategy, setup
        )
        for threshold_s in (0.1, 0.5)
    ]
    assert plans[0].identity != plans[1].identity


@pytest.mark.parametrize("seed", ["abc", "1_0", "-1"])
def test_a_seed_is_a_whole_number(
    tmp_path: Path, seed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert analytic_study(tmp_path).run("campaign", **key() | {"seed": seed}) == 2
    assert f"--seed: expected \\d+, got '{seed}'" in capsys.readouterr().err


def test_a_seed_is_one_of_the_studys(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = analytic_study(tmp_path)
    assert study.run("campaign", **key() | {"seed": 7}) == 2
    assert "--seed: there is no '7'; known are 0, 3" in capsys.readouterr().err
    assert not (study / "campaigns").exists()


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        (MODEL, None, "expected the detector of version 'base', found none"),
        (
            "space/F1.json",
            b"{",
            "damaged or edited, its SHA-256 is not the one in data/smoke/space/F1.json.stamp",
        ),
    ],
)
def test_bad_files_end_with_exit_code_2(
    tmp_path: Path,
    file: str,
    content: bytes | None,
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    study = analytic_study(tmp_path)
    if content is None:
        (study / file).unlink()
    else:
        (study / file).write_bytes(content)
    assert study.run("campaign", **key()) == 2
    assert f"blindspot step campaign: data/smoke/{file}: {message}" in capsys.readouterr().err


def test_a_truncated_table_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = analytic_study(tmp_path)
    for strategy in ("random", "mixed"):
        assert study.run("campaign", threads=2, **key(strategy)) == 0
    table = study / "campaigns/F1/mixed/base/3/tests.parquet"
    table.write_bytes(table.read_bytes()[:-200])
    assert study.run("cluster", scenario="F1", version="base") == 2
    assert (
        f"data/smoke/{table.relative_to(study / '')}: damaged or edited" in capsys.readouterr().err
    )


class Unsorted:
    """A foreign class that violates its contract if a person stands out from afar."""

    def __init__(self, model: str) -> None: ...

    def detect(self, frame: Frame) -> Detections:
        if frame.truth.contrast > 100 and 0 < frame.truth.visible_pixels < 100:
            return Detections(
                np.array([[0, 0, 9, 9], [0, 0, 9, 9]], np.float32), np.array([0.1, 0.9], np.float32)
            )
        return Detections.none()


def test_an_exception_in_a_foreign_detector_is_an_error_of_its_test_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    study = analytic_study(tmp_path, f"detector._target_={__name__}.Unsorted")
    assert study.run("campaign", **key("random")) == 0
    tests = tables.read_tests(folder(study, "random") / "tests.parquet")
    failed = tests["status"] == "error"
    assert failed.any() and set(tests.loc[failed, "reason"]) == {
        "Unsorted.detect failed: ValueError: scores must descend"
    }


def test_an_error_in_a_simulation_is_a_separate_outcome(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    study = analytic_study(tmp_path, "simulator._target_=tests.campaigns.Fragile")
    assert study.run("campaign", threads=2, **key("random")) == 0
    tests = tables.read_tests(folder(study, "random") / "tests.parquet")
    foggy, crashed = tests["fog"] > 70, (tests["rain"] > 92) & (tests["fog"] <= 70)
    assert foggy.any() and crashed.any()
    assert (tests["status"] == np.where(foggy | crashed, "error", "ok")).all()
    assert (tests.loc[foggy, "reason"] == "too much fog to simulate").all()
    assert (tests.loc[crashed, "reason"] == "process died (exit code 9)").all()
    assert (
        tests.loc[foggy | crashed, "adj_ttc_s"].isna().all()
        and not tests.loc[foggy | crashed, "failure"].any()
    )
