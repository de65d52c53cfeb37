"""Step `train`: the base of a study."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.model_card import read_card
from pipeline.detectors.evaluation import calibrate
from pipeline.detectors.yolo.export import export_onnx
from pipeline.detectors.yolo.weights import load_weights
from pipeline.learning.versions import detect_all
from tests.studies import ROOT, StudyFolder


def test_a_shipped_base_is_calibrated_on_the_same_images_as_the_other_versions(tmp_path: Path) -> None:
    study = StudyFolder.composed(tmp_path, "smoke", ["base_set.images=80", "base_set.validation_share=0.75"])
    assert study.run("render-base") == 0 and study.run("train") == 0
    validation, made, shipped = read_dataset(study / "base_set", "val"), study / "models/base", ROOT / "models/uniform"
    export_onnx(tmp_path / "plain.onnx", load_weights(made / "weights.safetensors"), validation.size)
    expected = calibrate(detect_all(tmp_path / "plain.onnx", validation, lambda *_: None), validation)
    found = read_card(made / "model.json")
    assert found.calibration == pytest.approx({"slope": expected.slope, "offset": expected.offset})
    assert found.calibration != read_card(shipped / "model.json").calibration
    assert found.weights_sha256 == read_card(shipped / "model.json").weights_sha256
