"""Command `quantise`: the int8 form of a detector of ours, and what it costs in average precision."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from pipeline.artefacts.dataset import read_dataset
from pipeline.artefacts.model_card import read_card
from pipeline.config.schema import Config
from pipeline.core.reliability import Calibration
from pipeline.detectors.evaluation import evaluate
from pipeline.detectors.quantisation import quantise
from pipeline.detectors.yolo.export import onnx_of
from pipeline.learning.versions import detect_all

CALIBRATION_IMAGES = 100


def run(config: Config, *, model: Path, base_set: Path, out: Path) -> str:
    """Write the int8 ONNX file; returns both forms' metrics as a table.

    model: folder of a version. base_set: truth.coco.json; its training images set the ranges, its validation images give the metrics.
    """
    threshold, calibration = float(config.detector.get("threshold", 0.5)), Calibration(**read_card(model / "model.json").calibration)
    training, validation = read_dataset(base_set.parent, "train"), read_dataset(base_set.parent, "val")
    shown = np.linspace(0, len(training) - 1, min(CALIBRATION_IMAGES, len(training))).astype(int)
    lines = ["form     AP50   AP50-95  false positives an image"]
    with tempfile.TemporaryDirectory() as folder:
        whole = onnx_of(model, Path(folder))
        quantise(whole, training.images[shown], out)
        for name, path in {"float32": whole, "int8": out}.items():
            metrics = evaluate(detect_all(path, validation, calibration), validation, threshold)
            lines.append(f"{name:8} {metrics['ap50']:.3f}  {metrics['ap50_95']:.3f}    {metrics['false_positives_an_image']:.4f}")
    return "\n".join([*lines, f"on {len(validation)} validation images at confidence {threshold:g}; {out}"])
