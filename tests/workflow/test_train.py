"""Step `train`: the base of a study."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import pytest

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.model_card import read_card
from pipeline.config.composing import compose
from pipeline.core.reliability import Calibration
from pipeline.core.worlds import Worlds
from pipeline.detectors.evaluation import calibrate
from pipeline.detectors.yolo.export import export_onnx
from pipeline.detectors.yolo.training import Fitted
from pipeline.detectors.yolo.weights import load_weights
from pipeline.learning import versions
from pipeline.learning.versions import detect_all
from tests.data_sets import PERSON, VISIBLE, detected, images
from tests.detectors.networks import small_network
from tests.studies import ROOT, StudyFolder


def test_a_shipped_base_is_calibrated_on_the_same_images_as_the_other_versions(
    tmp_path: Path,
) -> None:
    study = StudyFolder.composed(
        tmp_path, "smoke", ["base_set.images=80", "base_set.validation_share=0.75"]
    )
    assert study.run("render-base") == 0 and study.run("train") == 0
    validation, trained, shipped = (
        read_dataset(study / "base_set", "val"),
        study / "models/base",
        ROOT / "models/uniform",
    )
    export_onnx(
        tmp_path / "plain.onnx", load_weights(trained / "weights.safetensors"), validation.size
    )
    expected = calibrate(
        detect_all(tmp_path / "plain.onnx", validation, lambda *_: None), validation
    )
    card = read_card(trained / "model.json")
    assert card.calibration == pytest.approx({"slope": expected.slope, "offset": expected.offset})
    assert card.calibration != read_card(shipped / "model.json").calibration
    assert card.weights_sha256 == read_card(shipped / "model.json").weights_sha256


def test_a_version_is_measured_with_its_calibrated_scores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, out = compose("base", ["detector.threshold=0.5"]), tmp_path / "model.json"
    monkeypatch.setattr(versions, "export_onnx", Mock())
    monkeypatch.setattr(versions, "detect_all", lambda *_: [detected((PERSON, 0.3))])
    monkeypatch.setattr(versions, "calibrate", lambda *_: Calibration(slope=1, offset=3))
    assert Calibration(slope=1, offset=3).apply([0.3]) == pytest.approx([0.9], abs=0.01)
    origin = versions.Origin("base", None, {}, {}, 0, Worlds())
    versions.write_version(
        config, Fitted(small_network(), ()), images(VISIBLE), origin, out, lambda *_: None
    )
    assert read_card(out).metrics["recall"] == 1
