"""Step `train`: what a study's base is."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.artefacts.dataset import TRUTH_FILE, read_dataset
from pipeline.artefacts.model_card import read_card
from pipeline.config.composing import compose
from pipeline.detectors.evaluation import calibrate
from pipeline.detectors.yolo.export import export_onnx
from pipeline.detectors.yolo.weights import load_weights
from pipeline.learning.versions import detect_all
from pipeline.progress import Progress
from pipeline.steps import render_base, train


def test_a_shipped_base_is_calibrated_on_the_images_that_calibrate_the_versions_it_is_compared_with(tmp_path: Path) -> None:
    config = compose("smoke", ["base_set.images=80", "base_set.validation_share=0.75"])
    base_set, card = tmp_path / "base_set" / TRUTH_FILE, tmp_path / "base" / "model.json"
    render_base.run(config, out=base_set, threads=1, progress=lambda *_: None)
    with Progress("train") as progress:
        train.run(config, base_set=base_set, out=card, checkpoint=card.with_name("c.pt"), threads=1, progress=progress)
    validation = read_dataset(base_set.parent, "val")
    export_onnx(tmp_path / "plain.onnx", load_weights(card.with_name("weights.safetensors")), validation.size)
    expected, found = calibrate(detect_all(tmp_path / "plain.onnx", validation), validation), read_card(card)
    assert found.calibration == pytest.approx({"slope": expected.slope, "offset": expected.offset})
    assert found.calibration != read_card(Path(config.base.weights) / "model.json").calibration
    assert found.weights_sha256 == read_card(Path(config.base.weights) / "model.json").weights_sha256
