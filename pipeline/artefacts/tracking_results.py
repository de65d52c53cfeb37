"""tracking.json: what a study logged to MLflow."""

from __future__ import annotations

from typing import Literal

from pipeline.artefacts.results import Result

RunKind = Literal["study", "campaign", "comparison", "model"]


class TrackedRun(Result):
    """One MLflow run of the study's results: its name and the digest of its content."""

    name: str
    kind: RunKind
    digest: str


class TrackedStudy(Result):
    """Everything that was tracked, without run ids and times.

    The same study gives the same file on any store.
    """

    experiment: str
    model: str
    runs: tuple[TrackedRun, ...]
    failures: dict[str, int]
    champion: str
