"""Campaigns give the same bytes whatever the number of workers and however often they are killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from pipeline.__main__ import main
from pipeline.artefacts import tables
from pipeline.artefacts.scenario_space import read_space
from pipeline.config.composing import compose, dump
from pipeline.core import kpi
from pipeline.core.detections import Detections
from pipeline.core.episode import Episode, Frame
from pipeline.core.space import Value
from pipeline.errors import SimulationError
from pipeline.protocols import Detector
from pipeline.simulators.analytic import AnalyticSimulator

ROOT = Path(__file__).resolve().parents[2]
OVERRIDES = ["simulator=analytic", "detector=oracle", "campaign.tests=24", "samplers.neural.batch_size=8"]
FILES = ("tests.parquet", "signals.parquet", "frames.parquet")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with params.yaml of an analytic study, the space of F1 and a stand-in for a model file."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "params.yaml").write_text(dump(compose("smoke", OVERRIDES), "test"))
    (folder / "model.onnx").write_bytes(b"the oracle needs none")
    assert main(["define-space", "--scenario", "F1", "--out", str(folder / "F1.json"), "--params", str(folder / "params.yaml")]) == 0
    return folder


def arguments(study: Path, out: Path, threads: int, strategy: str = "neural", earlier: Sequence[Path] = ()) -> list[str]:
    return [
        "campaign", "--scenario", "F1", "--strategy", strategy, "--version", "base", "--seed", "3", "--space", str(study / "F1.json"),
        "--model", str(study / "model.onnx"), "--earlier", *map(str, earlier), "--out", str(out / "tests.parquet"),
        "--journal", str(out / "journal"), "--threads", str(threads),
        "--params", str(study / "params.yaml"), "--log", str(out / "log"),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def one_worker(study: Path) -> Path:
    out = study / "one"
    assert main(arguments(study, out, 1)) == 0
    return out


def same(one: Path, other: Path) -> bool:
    return all((one / name).read_bytes() == (other / name).read_bytes() for name in FILES)


def test_two_workers_give_the_same_bytes_as_one(study: Path, one_worker: Path) -> None:
    out = study / "two"
    assert main(arguments(study, out, 2)) == 0
    assert same(one_worker, out)
    assert not (out / "journal").exists()


def test_a_campaign_that_knows_another_one_asks_for_other_tests(study: Path, one_worker: Path) -> None:
    out, again = study / "taught", study / "taught again"
    assert main(arguments(study, out, 2, earlier=[one_worker / "tests.parquet"])) == 0
    assert main(arguments(study, again, 1, earlier=[one_worker / "tests.parquet"])) == 0
    assert same(out, again) and not same(one_worker, out)


def test_scenarios_share_a_seed_and_no_test(study: Path) -> None:
    params = ["--params", str(study / "params.yaml")]
    assert main(["define-space", "--scenario", "F1star", "--out", str(study / "F1star.json"), *params]) == 0
    fog = {}
    for scenario in ("F1", "F1star"):
        out = study / scenario
        words = {"F1": scenario, str(study / "F1.json"): str(study / f"{scenario}.json")}
        assert main([words.get(word, word) for word in arguments(study, out, 2, strategy="random")]) == 0
        fog[scenario] = set(tables.read_tests(out / "tests.parquet")["fog"])
    assert (len(fog["F1"]), len(fog["F1star"])) == (24, 8) and not fog["F1"] & fog["F1star"]


def finished(out: Path) -> int:
    return len(list((out / "journal").glob("*.npz")))


def test_a_campaign_killed_five_times_gives_the_same_bytes(study: Path, one_worker: Path, tmp_path: Path) -> None:
    for name in ("model.onnx", "F1.json"):
        (tmp_path / name).write_bytes((study / name).read_bytes())
    slow = [*OVERRIDES, "simulator._target_=tests.workflow.test_campaign.Slow"]
    (tmp_path / "params.yaml").write_text(dump(compose("smoke", slow), "test"))
    command, environment = [sys.executable, "-m", "pipeline", *arguments(tmp_path, tmp_path, 2)], {**os.environ, "PYTHONPATH": str(ROOT)}
    for _ in range(5):
        before = finished(tmp_path)
        process = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL)
        while process.poll() is None and finished(tmp_path) < before + 3:
            time.sleep(0.01)
        assert process.poll() is None, "the campaign ended before it could be killed"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        assert not (tmp_path / "tests.parquet").exists()
    subprocess.run(command, cwd=ROOT, env=environment, check=True, stderr=subprocess.DEVNULL)
    assert same(one_worker, tmp_path)


def test_rows_follow_from_the_signals(study: Path, one_worker: Path) -> None:
    tests, signals = tables.read_tests(one_worker / "tests.parquet"), tables.read_signals(one_worker / "signals.parquet")
    assert len(tests) == 24
    for row in tests.itertuples():
        own = signals[signals["test_id"] == row.test_id]
        again = kpi.evaluate({name: own[name].to_numpy() for name in own.columns}, 0.1)
        assert (again.adj_ttc_s, again.failure, again.failure_mode) == (row.adj_ttc_s, row.failure, row.failure_mode)
    assert set(tables.read_timings(one_worker / "timings.parquet")["test_id"]) == set(tests["test_id"])


def test_units_are_in_the_file(study: Path, one_worker: Path) -> None:
    import pyarrow.parquet as pq

    schema = pq.read_schema(one_worker / "tests.parquet")
    assert schema.field("fog").metadata == {b"unit": b"%"}
    assert schema.field("impact_speed_mps").metadata == {b"unit": b"m/s"}
    assert read_space(study / "F1.json")[1].names == tuple(schema.names[-8:])


def test_a_journal_of_another_model_is_discarded(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = study / "stale"
    (out / "journal").mkdir(parents=True)
    (out / "journal" / "identity.json").write_text('"of another model"')
    (out / "journal" / "000000.npz").write_bytes(b"foreign")
    assert main(arguments(study, out, 1, "random")) == 0
    assert "discarded" in (out / "log").read_text()


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("model.onnx", None, "expected the detector of version"),
        ("F1.json", b"{", "expected JSON"),
        ("F1.json", b"{}", "expected a scenario space"),
    ],
)
def test_bad_files_end_with_exit_code_2(
    study: Path, tmp_path: Path, file: str, content: bytes | None, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("params.yaml", "model.onnx", "F1.json"):
        (tmp_path / name).write_bytes((study / name).read_bytes())
    if content is None:
        (tmp_path / file).unlink()
    else:
        (tmp_path / file).write_bytes(content)
    assert main(arguments(tmp_path, tmp_path / "out", 1)) == 2
    error = capsys.readouterr().err
    assert message in error and file in error


def test_a_truncated_table_is_refused(study: Path, one_worker: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "tests.parquet"
    broken.write_bytes((one_worker / "tests.parquet").read_bytes()[:-200])
    common = ["--params", str(study / "params.yaml"), "--space", str(study / "F1.json")]
    assert main(["cluster", "--tests", str(broken), "--out", str(tmp_path / "r.json"), *common]) == 2
    assert str(broken) in capsys.readouterr().err


class Slow(AnalyticSimulator):
    """Leaves a test the time to kill it between two executions."""

    def execute(self, concrete: Mapping[str, Value], detector: Detector, keep_every: int = 0) -> Episode:
        time.sleep(0.1)
        return super().execute(concrete, detector, keep_every)


class Fragile(AnalyticSimulator):
    """A simulator that breaks on some scenarios and kills its process on one: for the executor's tests."""

    def execute(self, concrete: Mapping[str, Value], detector: Detector, keep_every: int = 0) -> Episode:
        if float(concrete["fog"]) > 70:
            raise SimulationError("too much fog to simulate")
        if float(concrete["rain"]) > 92:
            os._exit(9)
        return super().execute(concrete, detector, keep_every)


class Unsorted:
    """A stranger's class that breaks its contract on what a person is seen in."""

    def __init__(self, model: str) -> None: ...

    def detect(self, frame: Frame) -> Detections:
        if frame.truth.visible_pixels > 300:
            return Detections(np.array([[0, 0, 9, 9], [0, 0, 9, 9]], np.float32), np.array([0.1, 0.9], np.float32))
        return Detections.none()


def test_what_a_strangers_detector_raises_breaks_its_test_alone(study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name in ("model.onnx", "F1.json"):
        (tmp_path / name).write_bytes((study / name).read_bytes())
    overrides = ["simulator=analytic", "detector=oracle", "campaign.tests=24", f"detector._target_={__name__}.Unsorted"]
    (tmp_path / "params.yaml").write_text(dump(compose("smoke", overrides), "test"))
    assert main(arguments(tmp_path, tmp_path / "out", 1, "random")) == 0
    tests = tables.read_tests(tmp_path / "out" / "tests.parquet")
    broken = tests["status"] == "error"
    assert broken.any() and set(tests.loc[broken, "reason"]) == {"Unsorted.detect failed: ValueError: scores must descend"}


def test_a_broken_simulation_is_an_outcome_of_its_own(study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    overrides = [
        "simulator=analytic",
        "detector=oracle",
        "campaign.tests=24",
        "simulator._target_=tests.workflow.test_campaign.Fragile",
    ]
    for name in ("model.onnx", "F1.json"):
        (tmp_path / name).write_bytes((study / name).read_bytes())
    (tmp_path / "params.yaml").write_text(dump(compose("smoke", overrides), "test"))
    assert main(arguments(tmp_path, tmp_path / "out", 2, "random")) == 0
    tests = tables.read_tests(tmp_path / "out" / "tests.parquet")
    foggy, crashed = tests["fog"] > 70, (tests["rain"] > 92) & (tests["fog"] <= 70)
    assert foggy.any() and crashed.any()
    assert (tests["status"] == np.where(foggy | crashed, "error", "ok")).all()
    assert (tests.loc[foggy, "reason"] == "too much fog to simulate").all()
    assert tests.loc[crashed, "reason"].str.contains("process").all()
    assert tests.loc[foggy | crashed, "adj_ttc_s"].isna().all() and not tests.loc[foggy | crashed, "failure"].any()
