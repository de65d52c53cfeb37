"""Which jobs are out of date, and why."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.artefacts import stamps
from pipeline.artefacts.stamp_parts import MARKS, differences
from pipeline.workflow.jobs import Target
from pipeline.workflow.stamping import Stamps

REASONS = Path(".snakemake/changed")
"""Inputs of jobs that are out of date, named after what changed: always newer than the outputs.

Each job has a separate folder: while it plans, Snakemake lists a folder once, and treats files
that are written into it later as missing.
"""
SHOWN = 3
"""Largest number of such inputs of a job."""
LONGEST = 200
"""Characters of such a file's name; file systems take 255."""


@dataclass(frozen=True)
class Staleness:
    """Compares the stamps on the disk with today's."""

    today: Stamps
    _old: dict[Target, bool] = field(default_factory=dict)

    def out_of_date(self, target: Target) -> bool:
        """Whether a job has to run: its stamp is not today's, or a job before it runs again."""
        if target not in self._old:
            jobs = self.today.jobs
            makers = dict.fromkeys(map(jobs.maker, jobs.inputs(target)))
            again = (
                self._has_outputs(job) and self.out_of_date(job)
                for job in makers
                if job is not None
            )
            stamp = stamps.read(Path(jobs.outputs(target)[-1]))
            current = stamp is not None and stamp.depends == self._today(target)
            self._old[target] = not current or any(again)
        return self._old[target]

    def _today(self, target: Target) -> str:
        return self.today.stamp(target.step, dict(target.wildcards))

    def _has_outputs(self, target: Target) -> bool:
        return any(Path(path).exists() for path in self.today.jobs.outputs(target))

    def reasons(self, target: Target) -> Sequence[str]:
        """Why a job is out of date: the keys, variables and files that changed since it ran."""
        stamp = stamps.read(Path(self.today.jobs.outputs(target)[-1]))
        today = self._today(target)
        if stamp is None:
            return ("no_stamp",)
        if stamp.depends == today:
            return ("an_input_is_made_again",)
        return differences(stamp.depends, today) or ("other_settings_or_code",)

    def marks(self, target: Target) -> dict[str, list[str]]:
        """The inputs that make Snakemake run a job again, and show why; none without outputs."""
        if not self._has_outputs(target):
            return {}
        names = self.reasons(target)
        more = [f"and_{len(names) - SHOWN}_more"] if len(names) > SHOWN else []
        folder = REASONS.joinpath(target.step, *dict(target.wildcards).values())
        marks = [folder / file_name(name) for name in (*names[:SHOWN], *more)]
        folder.mkdir(parents=True, exist_ok=True)
        for mark in marks:
            # A newer file with the same content would not count.
            mark.write_text(str(time.time_ns()))
        return {MARKS: list(map(str, marks))}


def file_name(reason: str) -> str:
    """The name of the file that stands for a reason.

    It is no path: a reason may be the path of a person's file, which must not be written.
    """
    flat = re.sub(r"[^\w.-]+", "_", reason, flags=re.ASCII).lstrip("._")
    return flat[-LONGEST:] or "an_input"
