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

    Attributes:
        version: its name.
        parent: the version that training continued from, None for a base.
        data: digests of its training data and of its initial weights.
        training: settings used.
        seed: of the training.
        worlds: the towns and people in its training data.
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
    """Save a model version with its training curve, its calibration, its metrics and its card.

    All versions of a study, including a shipped base, are calibrated on the same images: otherwise
    the confidence at which they brake would mean a different precision for each version, and the
    comparison would measure that.

    Args:
        config: of the study.
        fitted: the trained network and its curve.
        validation: images for calibration and metrics.
        origin: what the version was trained from.
        out: the card; the other files are written beside it.
        progress: called with images done, their total and a text.
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
    # The file now includes the calibration, which keeps the boxes and the order of scores: no
    # second pass over the images.
    calibrated = []
    for raw in plain:
        scores = calibration.apply(raw.scores).astype(np.float32)
        calibrated.append(Detections(raw.boxes, scores))
    metrics, diagrams = evaluate(calibrated, validation, config.threshold), {}
    for name, detections in {"uncalibrated": plain, "calibrated": calibrated}.items():
        diagram = reliability(*judged_scores(detections, validation))
        metrics[f"calibration_error_{name}"] = calibration_error(diagram)
        diagrams[name] = tuple((part.score, part.right, part.count) for part in diagram)
    architecture = {"widths": list(model.architecture.widths), "head": model.architecture.head}
    training = {}
    for key, value in origin.training.items():
        training[key] = value if isinstance(value, str) else float(value)
    card = ModelCard(
        version=origin.version,
        parent=origin.parent,
        architecture=architecture,
        parameters=count_parameters(model),
        input_size=validation.size,
        seed=origin.seed,
        data=origin.data,
        training=training,
        metrics=metrics,
        calibration=asdict(calibration),
        reliability=diagrams,
        weights_sha256=sha256(weights),
        towns=tuple(sorted(origin.worlds.towns)),
        people=tuple(sorted(origin.worlds.people)),
    )
    write_card(out, card)


def detect_all(
    onnx: Path, images: ImageSet, progress: OnProgress, calibration: Calibration | None = None
) -> list[Detections]:
    """A model's detections in each image, down to scores far below its threshold.

    Args:
        onnx: the model's file.
        images: n images.
        progress: called with images done, their total and a text.
        calibration: inside the file, if any: the file then keeps the same detections as without it,
            and average precision is unchanged.

    Returns:
        (n,) detections.
    """
    lowest = LOWEST_SCORE
    if calibration is not None:
        lowest = float(calibration.apply(np.array([LOWEST_SCORE]))[0])
    detector = OnnxDetector(onnx, threshold=lowest)
    detections = []
    for i in range(len(images)):
        detections += detector.detect_images(images.images[i : i + 1])
        progress(i + 1, len(images), "validation images")
    return detections
