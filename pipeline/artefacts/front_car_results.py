"""The result files of the front-car study: points.json and evaluation.json."""

from __future__ import annotations

from pipeline.artefacts.results import Result


class CoveredPoint(Result):
    """A point, and the k-projection coverage of it and those before it. values: of each operating condition."""

    name: str
    values: dict[str, str]
    covered: int


class Points(Result):
    """points.json. existing: how many of the points are random; proposals follow. required: cells that feasible points reach."""

    k: int
    existing: int
    required: int
    points: tuple[CoveredPoint, ...]


class Judged(Result):
    """On which test snapshots of one point a detector was right: the forward vehicle found, or none there, and no false positive."""

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
    """evaluation.json. p_value: of the exact McNemar test that both detectors are right on equally many of the test snapshots."""

    threshold: float
    p_value: float
    detectors: tuple[DetectorResult, ...]
