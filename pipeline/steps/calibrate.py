"""Step `calibrate`: calibrates the confidences of a detector that a study only tests on the base set's validation images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.dataset import ImageSet, read_dataset
from pipeline.artefacts.files import sha256
from pipeline.artefacts.results import write
from pipeline.contract import Job, Step
from pipeline.core.detections import Detections
from pipeline.errors import InputError, SimulationError
from pipeline.progress import OnProgress

STEP = Step(
    "Calibrate the confidences of a detector under test.",
    reads=lambda folders, wildcards: {**folders.dataset("base_set"), "detector": folders.detector(wildcards["version"])},
    writes=lambda folders: {"calibration": folders.calibration("{version}")},
    sections=("detector",),
)


def run(job: Job) -> None:
    """Fit Platt scaling to the detector's scores and write it, with the reliability of the scores before and after it."""
    from pipeline.core.reliability import calibration_error, platt, reliability
    from pipeline.detectors.evaluation import judged_scores

    validation, model = read_dataset(job.input("truth").parent, "val"), job.input("detector")
    scores, right = judged_scores(_detect_all(job.config.detector, model, validation, job.progress), validation)
    calibration = platt(scores, right)
    shown = {"uncalibrated": scores, "calibrated": calibration.apply(scores)}
    diagrams = {name: reliability(values, right) for name, values in shown.items()}
    result = DetectorCalibration(
        version=job.wildcards["version"],
        slope=calibration.slope,
        offset=calibration.offset,
        detector_sha256=sha256(model),
        images_sha256=validation.digest,
        images=len(validation),
        detections=len(scores),
        right=int(right.sum()),
        reliability={name: tuple((b.score, b.right, b.count) for b in diagram) for name, diagram in diagrams.items()},
        errors={name: calibration_error(diagram) for name, diagram in diagrams.items()},
    )
    write(job.output("calibration"), result)


def _detect_all(section: Mapping[str, Any], model: Path, images: ImageSet, progress: OnProgress) -> list[Detections]:
    """The detections in each image, down to the lowest score that the calibration uses; InputError if the detector fails on an image."""
    from pipeline.config.components import make_detector
    from pipeline.core.episode import Frame
    from pipeline.detectors.evaluation import CALIBRATED_FROM, truths_of
    from pipeline.execution.guarded import GuardedDetector
    from pipeline.execution.worker import Calls

    lowest = {"threshold": CALIBRATED_FROM} if "threshold" in section else {}
    detector = GuardedDetector(make_detector({**section, **lowest}, model), Calls())
    found = []
    for done, (image, truth) in enumerate(zip(images.images, truths_of(images), strict=True), 1):
        try:
            found.append(detector.detect(Frame(image, truth)))
        except SimulationError as error:
            raise InputError(f"{model} fails on validation image {done}: {error}") from error
        progress(done, len(images), f"{sum(len(one.boxes) for one in found)} detections")
    return found
