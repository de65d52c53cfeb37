"""Stored tests follow from their detections, for every brake law, and can be driven again at
another IoU."""

from __future__ import annotations

import argparse
import re
import shutil
from collections.abc import Mapping
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.__main__ import main
from pipeline.analysis.rescoring import with_criterion
from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.results import write
from pipeline.artefacts.tables import read_detections, read_tests, write_detections
from pipeline.commands.rescore import judged
from pipeline.config.composing import compose
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.core.space import Space
from pipeline.detectors.calibrated import calibrated
from pipeline.execution import again
from pipeline.execution.again import Again
from pipeline.execution.points import Executor
from pipeline.execution.workers import Setup
from tests.studies import StudyFolder

CAMPAIGN: dict[str, Any] = {
    "kind": "campaigns",
    "scenario": "F1",
    "strategy": "random",
    "version": "base",
    "seed": 3,
}
SMALL = [
    "seeds=[3]",
    "simulator.camera.width=96",
    "simulator.camera.height=64",
    "campaign.tests=6",
    "samplers.random.batch_size=6",
    "search=[F1]",
]
NOISY = ["detector._target_=tests.workflow.test_rescore.Unsure"]
LAWS = {
    "thesis": [],
    "whole range, two of three": [
        "aeb.brakes_from=0.1",
        "aeb.why_below_threshold=a test",
        "aeb.votes=2",
        "aeb.window=3",
    ],
    "path, threshold": ["aeb.gate=detections", "aeb.law=threshold", "campaign.match_iou=0.3"],
}


class Unsure:
    """Reports the pedestrian with boxes and scores that jump, and now and then something else."""

    def __init__(
        self, model: str, threshold: float, iou: float, layout: None, person: None
    ) -> None:
        self._threshold = threshold

    def detect(self, frame: Frame) -> Detections:
        """Up to four boxes, drawn anew for each image."""
        rng = np.random.default_rng(int(frame.image.sum()))
        height, width = frame.image.shape[:2]
        true = frame.truth.visible_box or (0.4 * width, 0.5 * height, 0.45 * width, 0.7 * height)
        size = np.array([true[2] - true[0], true[3] - true[1]] * 2)
        boxes = np.clip(np.array(true) + rng.normal(0, 0.12, (4, 4)) * size, 0, [width, height] * 2)
        boxes[3] = (2, 2, 12, 30)
        scores = np.sort(rng.uniform(0, 1, 4))[::-1]
        kept = (
            (scores >= self._threshold) & (boxes[:, 2] > boxes[:, 0]) & (boxes[:, 3] > boxes[:, 1])
        )
        return Detections(boxes[kept].astype(np.float32), scores[kept].astype(np.float32))


def executed(
    root: Path, overrides: list[str], campaign: Mapping[str, Any] = CAMPAIGN
) -> StudyFolder:
    """A study with one executed campaign."""
    study = StudyFolder.composed(root, "smoke", [*SMALL, *NOISY, *overrides])
    assert study.run("define-space", scenario=campaign["scenario"]) == 0
    (study / "models/base").mkdir(parents=True)
    (study / "models/base/model.onnx").write_bytes(b"the detector needs none")
    assert study.run("campaign", **campaign) == 0
    return study


@pytest.fixture(scope="module", params=LAWS)
def law(request: pytest.FixtureRequest) -> list[str]:
    return LAWS[request.param]


@pytest.fixture(scope="module")
def study(law: list[str], tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    return executed(tmp_path_factory.mktemp("study"), law)


def folder(study: StudyFolder) -> Path:
    return study / "/".join(map(str, CAMPAIGN.values()))


def rescore(study: StudyFolder, *options: str) -> int:
    with chdir(study.root):
        return main(["rescore", "data/smoke/campaigns", *options])


def test_every_column_follows_from_detections_and_signals(
    study: StudyFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    assert len(read_detections(folder(study) / "detections.parquet")) > 100
    assert rescore(study) == 0
    assert "every KPI follows" in capsys.readouterr().out


def test_a_lost_detection_is_noticed(
    study: StudyFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = shutil.copytree(study / "campaigns", tmp_path / "campaigns")
    path = next(copy.rglob("detections.parquet"))
    detections = read_detections(path)
    write_detections(path, detections[detections["score"] < 0.8])
    path.with_name("tests.parquet.stamp").unlink()
    assert main(["rescore", str(copy), "--params", str(study.root / "params.yaml")]) == 1
    assert "differs in" in capsys.readouterr().out


def test_tests_are_driven_again_with_another_criterion(
    study: StudyFolder, law: list[str], tmp_path: Path
) -> None:
    table = tmp_path / "table.csv"
    assert (
        rescore(
            study,
            "--iou",
            "0.2",
            "--threshold",
            "0.3",
            "--drive",
            "--workers",
            "1",
            "--out",
            str(table),
        )
        == 0
    )
    (row,) = pd.read_csv(table).to_dict("records")
    other = executed(tmp_path / "again", [*law, "campaign.match_iou=0.2", "detector.threshold=0.3"])
    assert row["failures"] == read_tests(folder(other) / "tests.parquet")["failure"].sum()


def test_the_threshold_of_a_detector_without_one_is_zero(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = executed(
        tmp_path,
        ["detector=oracle", "detector._target_=pipeline.detectors.scripted.VisiblePixelOracle"],
    )
    assert rescore(study, "--iou", "0.5") == 0
    assert re.search(r"threshold +iou .*\n +base +0\.0 +0\.5 ", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--iou", "0.05"], "iou must be in [0.1, 1), got 0.05"),
        (["--iou", "0.3", "1"], "iou must be in [0.1, 1), got 1.0"),
        (["--iou", "nan"], "iou must be in [0.1, 1), got nan"),
        (["--threshold", "2"], "got 2.0"),
        (["--threshold", "nan"], "got nan"),
        (["--threshold", "0.01"], "--threshold must be at least 0.05"),
        (["--out", "nowhere/table.csv"], "table.csv: expected a file to write to"),
    ],
)
def test_wrong_options_are_told_before_any_work(
    options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rescore", "nowhere", *options]) == 2
    assert message in capsys.readouterr().err


def test_a_campaign_of_another_study_is_not_driven(
    study: StudyFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = StudyFolder.composed(tmp_path, "smoke", ["search=[F2]"])
    assert (
        main(
            ["rescore", str(folder(study)), "--drive", "--params", str(other.root / "params.yaml")]
        )
        == 2
    )
    assert "tests.parquet: expected a scenario of study smoke (F2" in capsys.readouterr().err


def test_tests_of_a_calibrated_detector_are_driven_again_calibrated(
    study: StudyFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    used: list[Setup] = []

    def driven_again(
        tests: Again, space: Space, failure_threshold_s: float, executor: Executor
    ) -> pd.DataFrame:
        used.append(executor.setup)
        return tests.tests

    monkeypatch.setattr(again, "driven_again", driven_again)
    calibration = DetectorCalibration(
        version="base",
        slope=2,
        offset=1,
        detector_sha256="",
        images_sha256="",
        images=1,
        detections=2,
        right=1,
        reliability={},
        errors={},
    )
    (tmp_path / "base.onnx").touch()
    config = compose(
        "smoke",
        [
            "search=[F1]",
            "goal=detectors",
            f"+tested.base={tmp_path / 'base.onnx'}",
            "calibrate=true",
        ],
    )
    write(tmp_path / Folders(config).calibration("base"), calibration)
    monkeypatch.chdir(tmp_path)
    judged(
        folder(study),
        config,
        with_criterion(config.car, 0.9, 0.3),
        argparse.Namespace(drive=True, workers=1),
    )
    assert [setup.detector for setup in used] == [calibrated(config.detector, calibration.scaling)]


def test_held_out_tests_at_a_second_iou_equal_a_study_with_that_iou(
    law: list[str], tmp_path: Path
) -> None:
    held_out = CAMPAIGN | {"kind": "held_out", "scenario": "F1star"}
    small = ["held_out=[F1star]", "comparison.tests=6", "comparison.strategy=random"]
    first = executed(tmp_path / "first", [*law, *small, "comparison.second_iou=0.7"], held_out)
    assert (
        first.run(
            "second-iou", **{name: value for name, value in held_out.items() if name != "kind"}
        )
        == 0
    )
    other = executed(tmp_path / "other", [*law, *small, "campaign.match_iou=0.7"], held_out)
    folders = [study / "/".join(map(str, held_out.values())) for study in (first, other)]
    result, expected = (
        read_tests(folders[0] / "second_iou.parquet"),
        read_tests(folders[1] / "tests.parquet"),
    )
    pd.testing.assert_frame_equal(result, expected)
    assert not result.equals(read_tests(folders[0] / "tests.parquet"))
