"""tracking.json: what MLflow holds of a study."""

from __future__ import annotations

from typing import Literal

from pipeline.artefacts.results import Result

RunKind = Literal["study", "campaign", "comparison", "model"]


class TrackedRun(Result):
    """One MLflow run that the study's results stand behind; its name and the digest of what was logged."""

    name: str
    kind: RunKind
    digest: str


class TrackedStudy(Result):
    """What was tracked. Holds neither run ids nor times: the same study gives the same file on any store."""

    experiment: str
    model: str
    runs: tuple[TrackedRun, ...]
    failures: dict[str, int]
    champion: str
