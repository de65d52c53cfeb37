"""Command `quantise`: makes the int8 form of our detector and prints what precision it loses."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from pipeline.config.project import typed
from pipeline.errors import InputError
from pipeline.progress import Progress

HELP = "Write the int8 form of our detector and print its loss of average precision."
CALIBRATION_IMAGES = 100


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--model",
        type=typed,
        default=Path("models/uniform"),
        help="folder of a model version (default: %(default)s)",
    )
    parser.add_argument(
        "--base-set",
        type=typed,
        default=Path("data/default/base_set/truth.coco.json"),
        help="folder or truth.coco.json of the base set that sets the ranges and gives the metrics "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--out", type=typed, default="int8.onnx", help="the file (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Write the int8 ONNX file and print the metrics of both forms.

    Training images set the ranges, validation images give the metrics.
    """
    from pipeline.artefacts.dataset import read_dataset
    from pipeline.artefacts.model_card import read_card
    from pipeline.config.composing import compose
    from pipeline.core.reliability import Calibration
    from pipeline.detectors.evaluation import evaluate
    from pipeline.detectors.quantisation import quantise
    from pipeline.detectors.yolo.export import onnx_of
    from pipeline.learning.versions import detect_all

    threshold = compose("default", []).threshold
    base_set = options.base_set if options.base_set.is_dir() else options.base_set.parent
    card = read_card(options.model / "model.json")
    calibration = Calibration(**card.calibration)
    training, validation = (read_dataset(base_set, split) for split in ("train", "val"))
    if training.size != card.input_size:
        raise InputError(
            f"--base-set: expected images of {card.input_size} px, as the detector was trained on, "
            f"got {training.size}"
        )
    shown = np.linspace(0, len(training) - 1, min(CALIBRATION_IMAGES, len(training))).astype(int)
    print("form     AP50   AP50-95  false positives per image")
    with tempfile.TemporaryDirectory() as folder, Progress("quantise") as progress:
        whole = onnx_of(options.model, Path(folder))
        quantise(whole, training.images[shown], options.out)
        for name, path in {"float32": whole, "int8": options.out}.items():
            detections = detect_all(path, validation, progress, calibration)
            metrics = evaluate(detections, validation, threshold)
            precision = f"{metrics['ap50']:.3f}  {metrics['ap50_95']:.3f}"
            print(f"{name:8} {precision}    {metrics['false_positives_an_image']:.4f}")
    print(f"on {len(validation)} validation images at confidence {threshold:g}; {options.out}")
    return 0
