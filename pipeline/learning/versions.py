"""Saves a model version: calibrated, measured, with its card."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from pipeline.artefacts.dataset import ImageSet
from pipeline.artefacts.files import sha256
from pipeline.artefacts.model_card import ModelCard, write_card, write_curve
from pipeline.config.schema import Config
from pipeline.core.detections import Detections
from pipeline.core.reliability import Calibration, calibration_error, reliability
from pipeline.core.worlds import Worlds
from pipeline.detectors.evaluation import calibrate, evaluate, judged_scores
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import export_onnx
from pipeline.detectors.yolo.network import count_parameters
from pipeline.detectors.yolo.training import Fitted
from pipeline.detectors.yolo.weights import load_weights, save_weights
from pipeline.progress import OnProgress

LOWEST_SCORE = 0.0005
"""Lowest score that average precision uses; it needs detections far below the brake's threshold."""


@dataclass(frozen=True)
class Origin:
    """The origin of a version.

    version: its name. parent: the version that training continued from, None for a base. data: digests of its training data and of its
    initial weights. training: settings used. worlds: the towns and people in its training data.
    """

    version: str
    parent: str | None
    data: dict[str, str]
    training: dict[str, Any]
    seed: int
    worlds: Worlds


def write_version(
    config: Config,
    fitted: Fitted,
    validation: ImageSet,
    origin: Origin,
    out: Path,
    progress: OnProgress,
) -> None:
    """Save a model version and its training curve beside `out`, calibrate its scores, measure it as it is used, and write its card.

    All versions of a study, including a shipped base, are calibrated on the same images: otherwise the confidence at which they brake would
    mean a different precision for each version, and the comparison would measure that.
    """
    model = fitted.model
    out.unlink(missing_ok=True)  # The card of an earlier version describes other weights.
    write_curve(out.with_name("curve.csv"), fitted.curve)
    weights, onnx = out.with_name("weights.safetensors"), out.with_name("model.onnx")
    save_weights(weights, model)
    saved = load_weights(weights)  # Measure the saved weights, in half precision.
    with TemporaryDirectory() as folder:
        export_onnx(Path(folder) / "plain.onnx", saved, validation.size)
        plain = detect_all(Path(folder) / "plain.onnx", validation, progress)
    calibration = calibrate(plain, validation)
    export_onnx(onnx, saved, validation.size, calibration)
    # The file now includes the calibration, which keeps the boxes and the order of scores: no second pass over the images.
    found = [
        Detections(one.boxes, calibration.apply(one.scores).astype(np.float32)) for one in plain
    ]
    diagrams = {
        name: reliability(*judged_scores(f, validation))
        for name, f in {"uncalibrated": plain, "calibrated": found}.items()
    }
    errors = {
        f"calibration_error_{name}": calibration_error(diagram)
        for name, diagram in diagrams.items()
    }
    architecture = {"widths": list(model.architecture.widths), "head": model.architecture.head}
    card = ModelCard(
        version=origin.version,
        parent=origin.parent,
        architecture=architecture,
        parameters=count_parameters(model),
        input_size=validation.size,
        seed=origin.seed,
        data=origin.data,
        training={
            key: value if isinstance(value, str) else float(value)
            for key, value in origin.training.items()
        },
        metrics=evaluate(found, validation, config.threshold) | errors,
        calibration=asdict(calibration),
        reliability={
            name: tuple((b.score, b.right, b.count) for b in diagram)
            for name, diagram in diagrams.items()
        },
        weights_sha256=sha256(weights),
        towns=tuple(sorted(origin.worlds.towns)),
        people=tuple(sorted(origin.worlds.people)),
    )
    write_card(out, card)


def detect_all(
    onnx: Path, images: ImageSet, progress: OnProgress, calibration: Calibration | None = None
) -> list[Detections]:
    """A model's detections in each image, down to scores far below its threshold. calibration: the one inside the file, if any: the file
    then keeps the same detections as without it, and average precision is unchanged."""
    lowest = (
        LOWEST_SCORE
        if calibration is None
        else float(calibration.apply(np.array([LOWEST_SCORE]))[0])
    )
    detector = OnnxDetector(onnx, threshold=lowest)
    found = []
    for i in range(len(images)):
        found += detector.detect_images(images.images[i : i + 1])
        progress(i + 1, len(images), "validation images")
    return found
