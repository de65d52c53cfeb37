"""The result files of the front-car study: points.json and evaluation.json."""

from __future__ import annotations

from pipeline.artefacts.results import Result


class CoveredPoint(Result):
    """A point, and the k-projection coverage of the points up to it.

    Attributes:
        values: of each operating condition.
    """

    name: str
    values: dict[str, str]
    covered: int


class Points(Result):
    """points.json.

    Attributes:
        existing: number of random points; proposals follow.
        required: number of cells that feasible points reach.
    """

    k: int
    existing: int
    required: int
    points: tuple[CoveredPoint, ...]


class Judged(Result):
    """The test snapshots of one point that a detector gets right.

    In these, it detects the forward vehicle, or reports none if there is none, without a false
    positive.
    """

    values: dict[str, str]
    right: tuple[bool, ...]


class DetectorResult(Result):
    """One detector. metrics: as `evaluate` gives them. points: test snapshots by feasible point."""

    version: str
    learnt_points: int
    images: int
    metrics: dict[str, float]
    points: tuple[Judged, ...]


class Evaluation(Result):
    """evaluation.json."""

    threshold: float
    detectors: tuple[DetectorResult, ...]
