"""Step `calibrate`: calibrates the confidences of a detector that a study only tests.

It uses the validation images of the base set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.dataset import ImageSet, read_dataset
from pipeline.artefacts.files import sha256
from pipeline.artefacts.results import write
from pipeline.contract import Job, Step
from pipeline.core.detections import Detections
from pipeline.errors import InputError, SimulationError
from pipeline.progress import OnProgress

if TYPE_CHECKING:
    from pipeline.config.schema import Config
    from pipeline.core.episode import Frame
    from pipeline.execution.worker import Calls

STEP = Step(
    "Calibrate the confidences of a detector under test.",
    reads=lambda folders, wildcards: {
        **folders.dataset("base_set"),
        "detector": folders.detector(wildcards["version"]),
    },
    writes=lambda folders: {"calibration": folders.calibration("{version}")},
    sections=("detector", "limits"),
)


def run(job: Job) -> None:
    """Fit Platt scaling to the detector's scores and write it.

    The file also has the reliability of the scores before and after.
    """
    from pipeline.core.reliability import calibration_error, platt, reliability
    from pipeline.detectors.evaluation import judged_scores

    validation, model = read_dataset(job.input("truth").parent, "val"), job.input("detector")
    detections = detect_all(job.config, model, validation, job.progress)
    scores, right = judged_scores(detections, validation)
    calibration = platt(scores, right)
    diagrams = {
        "uncalibrated": reliability(scores, right),
        "calibrated": reliability(calibration.apply(scores), right),
    }
    rows = {}
    for name, diagram in diagrams.items():
        rows[name] = tuple((bin_.score, bin_.right, bin_.count) for bin_ in diagram)
    result = DetectorCalibration(
        version=job.wildcards["version"],
        slope=calibration.slope,
        offset=calibration.offset,
        detector_sha256=sha256(model),
        images_sha256=validation.digest,
        images=len(validation),
        detections=len(scores),
        right=int(right.sum()),
        reliability=rows,
        errors={name: calibration_error(diagram) for name, diagram in diagrams.items()},
    )
    write(job.output("calibration"), result)


def detect_all(
    config: Config, model: Path, images: ImageSet, progress: OnProgress
) -> list[Detections]:
    """The detections in each image, down to the lowest score that the calibration uses.

    The detector runs in a separate process with the limits of a test.

    Args:
        config: the section `detector`, and the limits.
        model: the detector's file.
        images: n images.
        progress: called after each image.

    Returns:
        n detections, in the order of the images.

    Raises:
        InputError: the detector fails on an image.
    """
    from pipeline.core.episode import Frame
    from pipeline.detectors.evaluation import CALIBRATED_FROM, truths_of
    from pipeline.execution.worker import Broken, Pool

    lowest = {"threshold": CALIBRATED_FROM} if "threshold" in config.detector else {}
    make = partial(_detection, {**config.detector, **lowest}, model)
    frames = list(map(Frame, images.images, truths_of(images)))
    detections: dict[int, Detections] = {}
    boxes = 0
    with Pool(1, make, config.limits) as pool:
        for index, outcome in pool.run(frames):
            if isinstance(outcome, Broken | str):
                reason = outcome.reason if isinstance(outcome, Broken) else outcome
                raise InputError(f"{model} fails on validation image {index + 1}: {reason}")
            detections[index] = outcome
            boxes += len(outcome.boxes)
            progress(len(detections), len(images), f"{boxes} detections")
    return [detections[index] for index in range(len(images))]


def _detection(
    section: Mapping[str, Any], model: Path, calls: Calls
) -> Callable[[Frame], Detections | str]:
    """A function that detects in a frame; it returns the reason if the detector fails."""
    from pipeline.config.components import make_detector
    from pipeline.execution.guarded import GuardedDetector

    detector = GuardedDetector(make_detector(section, model), calls)

    def detect(frame: Frame) -> Detections | str:
        try:
            return detector.detect(frame)
        except SimulationError as error:
            return str(error)

    return detect
