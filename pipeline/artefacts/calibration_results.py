"""calibration/<detector>.json: how the confidences of a detector under test are calibrated, and how
reliable they are.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pipeline.artefacts.results import Result, read
from pipeline.core.reliability import Calibration

Diagram = tuple[tuple[float, float, int], ...]
"""Rows of mean score, share of right detections and number of detections."""


class DetectorCalibration(Result):
    """The calibration of one detector, fitted on validation images.

    Attributes:
        slope, offset: of the scores' logits; 1 and 0 leave the scores as they are.
        detector_sha256, images_sha256: what it was fitted to.
        detections, right: number of detections that it was fitted to, and of the right ones among
            them.
        reliability: diagrams of the scores on these images, `uncalibrated` and `calibrated`.
        errors: their expected calibration errors, in [0, 1].
    """

    version: str
    slope: float
    offset: float
    detector_sha256: str
    images_sha256: str
    images: int
    detections: int
    right: int
    reliability: dict[str, Diagram]
    errors: dict[str, float]

    @property
    def scaling(self) -> Calibration:
        """The calibration that the tests apply."""
        return Calibration(self.slope, self.offset)

    @property
    def fitted(self) -> bool:
        """False if the scores could not be calibrated.

        This is so if all or none of the detections are right, or if higher scores are not right
        more often.
        """
        return self.scaling != Calibration()


def read_calibration(paths: Iterable[str | Path]) -> DetectorCalibration | None:
    """The calibration of one detector; None unless the study calibrates it.

    Args:
        paths: the file, or nothing.
    """
    return next((read(Path(path), DetectorCalibration) for path in paths), None)
