"""Executes a list of concrete scenarios outside any campaign."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.core.space import Value
from pipeline.execution.journal import Journal
from pipeline.execution.workers import Execution, Setup, Workers
from pipeline.progress import Progress


def executed(points: Sequence[Mapping[str, Value]], setup: Setup, folder: Path, threads: int, progress: Progress) -> Journal:
    """The journal with the outcome of each concrete scenario, by its position; the caller removes it.

    folder: of the journal, from which a killed call resumes.
    """
    log, workers = Journal(folder, _identity(setup, points), progress), Workers(threads, setup)
    jobs = [Execution(i, log.path(i), point) for i, point in enumerate(points) if i not in log]
    try:
        for done, _ in enumerate(workers.execute(jobs), 1 + len(points) - len(jobs)):
            progress(done, len(points))
    finally:
        workers.close()
    return log


def _identity(setup: Setup, points: Sequence[Mapping[str, Value]]) -> str:
    return hashlib.sha256(json.dumps([setup.identity, points], sort_keys=True).encode()).hexdigest()
