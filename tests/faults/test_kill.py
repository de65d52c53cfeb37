"""kill -9 in training, filtering, registration and executions.

The next run resumes, makes no duplicates and reads no partial file.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.artefacts.files import read_sealed
from pipeline.artefacts.filter_table import read_filter
from pipeline.artefacts.model_card import read_card
from pipeline.core.detections import Detections
from pipeline.core.encounter import Encounter
from pipeline.core.episode import Frame
from pipeline.core.space import Value
from pipeline.detectors.yolo.weights import load_weights
from pipeline.simulators.analytic import AnalyticWorld
from tests.analysis.fabricated import FabricatedStudy
from tests.campaigns import OVERRIDES, analytic_study
from tests.studies import ROOT, StudyFolder, arguments

TRAIN = """
import sys
from pathlib import Path
import numpy as np
from pipeline.artefacts.dataset import image_set
from pipeline.config.composing import compose
from pipeline.detectors.yolo import training
from pipeline.detectors.yolo.network import Architecture, Yolo
from pipeline.detectors.yolo.training import Lesson, Run, Schedule, fit, initial_model
from pipeline.core.truth import Truth
from pipeline.core.worlds import Worlds
from pipeline.learning.versions import Origin, write_version

training.CHECKPOINT_SECONDS = 0.2
out, rng = Path(sys.argv[1]), np.random.default_rng(0)
box = (20.0, 10.0, 40.0, 50.0)
truth = Truth(box, box, 800, 800, 30.0)
images = image_set(
    [(rng.integers(0, 255, (64, 96, 3), dtype=np.uint8), truth) for _ in range(4)], "x"
)
model = initial_model(0, lambda: Yolo(Architecture((8, 8, 8, 8, 8), 8)))
feed = lambda iteration: (np.roll(images.images, iteration, axis=2), images.boxes)
print("ready", flush=True)
lesson = Lesson(Schedule(0, 120, 1e-3), feed, "x")
fitted = fit(model, lesson, Run(out / "checkpoint.pt", threads=1))
origin = Origin("base", None, {}, {}, 0, Worlds())
write_version(compose("base", []), fitted, images, origin, out / "model.json", lambda *_: None)
"""

FILTER = """
import sys
from pathlib import Path
from tests.analysis.fabricated import FabricatedStudy
study = FabricatedStudy(Path(sys.argv[1]))
print("ready", flush=True)
study.run("filter", kind="filter", strategy="random", version="base")
"""

REGISTER = """
import sys
from pathlib import Path
from pipeline.tracking.registry import Registration, Registry
from pipeline.tracking.runs import Content, Tracker
root = Path(sys.argv[1])
tracker = Tracker(root / "m.db", root / "artifacts", "e", {})
registry = Registry(tracker)
print("ready", flush=True)
for version in ("base", "control", "random"):
    file = root / f"{version}.json"
    file.write_text(version)
    metrics = {f"m{i}": float(i) for i in range(50)}
    content = Content(f"s/{version}", "model", metrics=metrics, files=[file])
    number, _ = registry.register(Registration("detector", content, [file], {"version": version}))
    registry.set_alias("detector", "champion", number)
"""

OPEN = """
import sys
from pathlib import Path
from pipeline.tracking.runs import Tracker
print("ready", flush=True)
print(Tracker(Path(sys.argv[1]) / "m.db", Path(sys.argv[1]) / "artifacts", "e", {}).experiment)
"""


STEP = """
import os
import sys
from pipeline.__main__ import main
os.chdir(sys.argv[1])
print("ready", flush=True)
sys.exit(main(sys.argv[2:]))
"""
EXECUTED = "executed"
"""The file in which `Noted` notes its executions."""
NOTED = f"simulator._target_={__name__}.Noted"


class Noted(AnalyticWorld):
    """Executes slowly enough to be killed between two tests, and notes each execution."""

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        time.sleep(0.1)
        with Path(EXECUTED).open("a") as file:
            file.write(".")
        return super().reset(concrete, seed)


class Large:
    """Draws its box 1.6 times as wide as the pedestrian, which matches at an IoU of 0.5 alone."""

    def __init__(self, model: str) -> None: ...

    def detect(self, frame: Frame) -> Detections:
        if frame.truth.visible_box is None:
            return Detections.none()
        left, top, right, bottom = frame.truth.visible_box
        return Detections(
            np.array([(left, top, left + 1.6 * (right - left), bottom)], np.float32),
            np.ones(1, np.float32),
        )


def killed(
    script: str, *arguments: Path | str, after_s: float = 0.0, until: Path | None = None
) -> bool:
    """Run a script and kill it a given time after it is ready, or once a file exists.

    Returns whether it was still running.
    """
    process = subprocess.Popen(
        [sys.executable, "-c", script, *map(str, arguments)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    while process.stdout.readline().strip() not in ("ready", ""):
        pass
    time.sleep(after_s)
    while until is not None and not until.exists() and process.poll() is None:
        time.sleep(0.02)
    alive = process.poll() is None
    process.kill()
    process.wait()
    return alive


def finish(script: str, *arguments: Path | str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_in_training(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    finish(TRAIN, whole)
    assert killed(TRAIN, cut, until=cut / "checkpoint.pt")
    assert (cut / "checkpoint.pt").exists() and not (cut / "weights.safetensors").exists()
    before = torch.load(io.BytesIO(read_sealed(cut / "checkpoint.pt")), weights_only=True)[
        "iteration"
    ]
    assert 0 < before < 120
    killed(TRAIN, cut, after_s=0.5)
    finish(TRAIN, cut)
    assert (cut / "weights.safetensors").read_bytes() == (
        whole / "weights.safetensors"
    ).read_bytes()
    assert read_card(cut / "model.json") == read_card(whole / "model.json")
    load_weights(cut / "weights.safetensors")
    assert not list(cut.glob(".*.tmp"))


def test_in_filtering(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    table = study.root / "filter/random/base.csv"
    finish(FILTER, tmp_path)
    whole = table.read_bytes()
    table.unlink()
    at_work = []
    for after_s in (0.0, 0.05, 0.2):
        at_work.append(killed(FILTER, tmp_path, after_s=after_s))
        if table.exists():
            read_filter(table)
    assert any(at_work)
    finish(FILTER, tmp_path)
    assert table.read_bytes() == whole


def test_what_a_killed_writer_left_is_removed_by_the_next_job(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    table = study.root / "filter/random/base.csv"
    left = [table.with_name(f".{name}.12345.tmp") for name in ("base.csv", "base.csv.stamp")]
    of_another_job = table.with_name(".other.csv.12345.tmp")
    for path in (*left, of_another_job):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("half")
    finish(FILTER, tmp_path)
    assert table.exists() and of_another_job.exists()
    assert not any(path.exists() for path in left)


def test_while_the_store_is_made(tmp_path: Path) -> None:
    making = tmp_path / ".m.db.making"
    assert killed(OPEN, tmp_path, until=making)
    assert making.exists() and not (tmp_path / "m.db").exists()
    finish(OPEN, tmp_path)
    assert (tmp_path / "m.db").exists() and not making.exists()


def test_in_registration(tmp_path: Path) -> None:
    from mlflow import MlflowClient

    assert any([killed(REGISTER, tmp_path, after_s=after_s) for after_s in (0.2, 0.6, 1.2)])
    finish(REGISTER, tmp_path)
    finish(REGISTER, tmp_path)
    uri = f"sqlite:///{tmp_path / 'm.db'}"
    client = MlflowClient(tracking_uri=uri, registry_uri=uri)
    experiment = client.get_experiment_by_name("e").experiment_id
    versions = client.search_model_versions("name = 'detector'")
    assert sorted(version.tags["version"] for version in versions) == ["base", "control", "random"]
    assert client.get_model_version_by_alias("detector", "champion").tags["version"] == "random"
    assert {run.info.status for run in client.search_runs([experiment])} == {"FINISHED"}
    assert (
        len(client.search_runs([experiment])) == len(client.search_logged_models([experiment])) == 3
    )
    for version in versions:
        (file,) = Path(version.source.removeprefix("file://")).glob("*.json")
        assert file.read_text() == version.tags["version"]


def resumed(
    whole: StudyFolder, cut: StudyFolder, step: str, until: tuple[str, ...], **wildcards: str
) -> int:
    """Kill a step once each of these files of its journal exists.

    Returns how many tests it executes twice.
    """
    words = arguments(step, 1, **wildcards)
    for study in (whole, cut):
        (study.root / EXECUTED).write_text("")
    finish(STEP, whole.root, *words)
    for path in until:
        assert killed(STEP, cut.root, *words, until=cut / "journal" / path), (
            "the step ended before it could be killed"
        )
    finish(STEP, cut.root, *words)
    assert not list((cut / "journal").rglob("*.npz")), "the journal is removed"
    return len((cut.root / EXECUTED).read_text()) - len((whole.root / EXECUTED).read_text())


def test_in_confirming_and_explaining_regions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    small = [
        "seeds=[0]",
        "campaign.tests=160",
        "strategies=[mixed]",
        "~arms.random",
        "regions.confirm=4",
        "regions.explain=2",
    ]
    study = analytic_study(tmp_path / "whole", *small)
    assert (
        study.run(
            "campaign", kind="campaigns", scenario="F1", strategy="mixed", version="base", seed=0
        )
        == 0
    )
    shutil.copytree(tmp_path / "whole", tmp_path / "cut", symlinks=True)
    whole, cut = (
        StudyFolder.composed(tmp_path / name, "smoke", [*OVERRIDES, *small, NOTED])
        for name in ("whole", "cut")
    )
    until = ("cluster/base/F1/confirm/000003.npz", "cluster/base/F1/explain/without/000003.npz")
    assert resumed(whole, cut, "cluster", until, scenario="F1", version="base") <= len(until)
    for name in ("F1.json", "F1.parquet"):
        assert (cut / f"regions/base/{name}").read_bytes() == (
            whole / f"regions/base/{name}"
        ).read_bytes()


def test_in_judging_at_a_second_iou(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    small = [
        "comparison.tests=8",
        "comparison.second_iou=0.7",
        f"detector._target_={__name__}.Large",
    ]
    whole, cut = (analytic_study(tmp_path / name, *small, NOTED) for name in ("whole", "cut"))
    test = {"scenario": "F1star", "strategy": "pairwise", "version": "base", "seed": "0"}
    for study in (whole, cut):
        assert study.run("campaign", 1, kind="held_out", **test) == 0
    assert (
        resumed(whole, cut, "second-iou", ("second_iou/F1star/pairwise/base/0/000003.npz",), **test)
        <= 1
    )
    path = "held_out/F1star/pairwise/base/0/second_iou.parquet"
    assert (cut / path).read_bytes() == (whole / path).read_bytes()
