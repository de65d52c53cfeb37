"""Executes a list of concrete scenarios outside any campaign."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from pipeline.core.space import Value
from pipeline.execution.journal import Journal, Outcome
from pipeline.execution.workers import Execution, Setup, Workers
from pipeline.progress import Progress

Concrete = Mapping[str, Value]


@dataclass(frozen=True)
class Executor:
    """What executes concrete scenarios.

    journal: folder from which a killed call resumes; the caller removes it.
    """

    setup: Setup
    journal: Path
    threads: int
    progress: Progress

    def outcomes(
        self, points: Sequence[Concrete], noises: Sequence[Concrete] = ()
    ) -> list[Outcome]:
        """The outcome of each concrete scenario.

        noises: the concrete scenarios whose noise they have, their own by default.
        """
        identity = json.dumps([self.setup.identity, points, noises], sort_keys=True)
        digest = hashlib.sha256(identity.encode()).hexdigest()
        log = Journal(self.journal, digest, self.progress)
        given: Sequence[Concrete | None] = noises or [None] * len(points)
        jobs = [
            Execution(i, log.path(i), point, noise)
            for i, (point, noise) in enumerate(zip(points, given, strict=True))
            if i not in log
        ]
        with closing(Workers(self.threads, self.setup)) as workers:
            for done, _ in enumerate(workers.execute(jobs), 1 + len(points) - len(jobs)):
                self.progress(done, len(points))
        return [log.read(i) for i in range(len(points))]
