"""The plan of a study as Snakemake needs it.

It has the files, the log and the stamp of each rule, and what follows at the end of a run.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from snakemake.io import ancient, directory, report, temp
from snakemake.settings.types import DAGSettings

from pipeline.config.components import check_components
from pipeline.config.composing import PARAMS, of_snakemake
from pipeline.contract import VERDICT_FOLLOWS, Files
from pipeline.errors import InputError
from pipeline.report.catalogue import entry
from pipeline.workflow.guards import alone, check_source, end, params_of
from pipeline.workflow.jobs import Jobs, Target
from pipeline.workflow.staleness import Staleness
from pipeline.workflow.stamping import Stamps

if TYPE_CHECKING:
    from snakemake.workflow import Workflow

DEFAULT_LIMIT = (100, 1)
"""Jobs and seconds of Snakemake's own `--max-jobs-per-timespan`."""


@dataclass(frozen=True)
class Plan:
    """What Snakemake's rules are made from.

    Attributes:
        jobs: the jobs of the study.
        params: the file of the config.
        stored: whether the files are in one of Snakemake's storages.
        begin: called before the plan looks at any file.
    """

    jobs: Jobs
    params: Path = PARAMS
    stored: bool = False
    begin: Callable[[], None] = lambda: None

    @cached_property
    def staleness(self) -> Staleness:
        return Staleness(Stamps(self.jobs))

    def reads(self, name: str) -> Callable[[Any], dict[str, Any]]:
        """The input function of a step's rule.

        Stamps decide what is out of date. The inputs' times do not count for a job that is up to
        date; any other job reads a file that is always newer. In a storage, Snakemake's own records
        decide.
        """

        def read(wildcards: Mapping[str, str]) -> dict[str, Any]:
            self.begin()
            target = Target.of(name, wildcards)
            files = dict(self.jobs.contracts[name].reads(self.jobs.folders, dict(target.wildcards)))
            if self.stored:
                return files
            if self.staleness.out_of_date(target):
                # Snakemake follows a job that runs again only through inputs that are not ancient.
                return {**files, **self.staleness.marks(target)}
            return _each(ancient, files)

        return read

    def writes(self, name: str) -> dict[str, Any]:
        """The outputs of a step's rule.

        Pages and plots go into Snakemake's own report, files of parts are deleted after use.
        """
        outputs = self.jobs.contracts[name].outputs(self.jobs.folders)
        is_part = name in {step.parts for step in self.jobs.contracts.values()}
        return _each(temp if is_part else _flagged, outputs)

    def log(self, name: str, suffix: str) -> str:
        """The path of a job's log or benchmark."""
        names = self.jobs.contracts[name].names(self.jobs.folders)
        wildcards = [f"{{{wildcard}}}" for wildcard in names]
        return "/".join(["logs", self.jobs.config.study, name, *wildcards]) + suffix

    def stamps(self, name: str) -> Callable[[Any], str]:
        """The stamp of a rule's job, by its wildcards."""
        return lambda wildcards: self.staleness.today.stamp(name, dict(wildcards.items()))

    def finish(self, asked: DAGSettings) -> None:
        """Print the verdict after a run of the whole study, or of its last step.

        In a storage, the study's files are not at hand.
        """
        targets = set(asked.targets)
        whole = not targets or targets & {"all", "track"} or targets >= set(self.jobs.folders.goals)
        limited = asked.until or asked.omit_from or asked.allowed_rules or asked.batch
        if whole and not limited and not self.stored and VERDICT_FOLLOWS not in os.environ:
            command = [sys.executable, "-m", "pipeline", "verdict", "--params", str(self.params)]
            subprocess.run(command, check=False)


def plan(config: Mapping[str, Any], workflow: Workflow, steps: Sequence[str]) -> Plan:
    """The plan of Snakemake's config, for the Snakefile.

    Args:
        config: Snakemake's `config`, as params.yaml has it.
        workflow: Snakemake's `workflow`.
        steps: the names of all steps, in the order of the data flow.

    An InputError ends the program with one line and exit code 2.
    """
    stored = workflow.storage_settings.default_storage_provider is not None
    try:
        params = params_of(workflow)
        checked = of_snakemake(config, params)
        check_source(checked, workflow)
        check_components(checked)
        return Plan(Jobs(checked, tuple(steps)), params, stored, cache(lambda: alone(workflow)))
    except InputError as error:
        end(error)


def lift_default_limit(workflow: Workflow) -> None:
    """Lift Snakemake's default limit of 100 jobs a second, but no other, before the first job.

    While there is a limit, Snakemake 9.27 starts a timer each time it looks for jobs, and looks
    again when the timer ends. So each finished job leaves one more chain of timers, each of which
    reads the sizes of all input files every second: after 80 jobs, a quarter of a core.
    """
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if limit is not None and (limit.max_jobs, limit.timespan) == DEFAULT_LIMIT:
        workflow.scheduler.job_rate_limiter = None


def _each(flag: Callable[[str], Any], files: Mapping[str, Files]) -> dict[str, Any]:
    """Declared files with a flag of Snakemake on each."""
    flagged: dict[str, Any] = {}
    for key, paths in files.items():
        flagged[key] = flag(paths) if isinstance(paths, str) else list(map(flag, paths))
    return flagged


def _flagged(path: str) -> Any:
    """An output as a folder, as an entry of Snakemake's report, or as it is."""
    if path.endswith("/"):
        return directory(path)
    if not path.endswith((".html", ".png")):
        return path
    listed = entry(path)
    return report(
        path, caption=listed.caption, category=listed.category, labels=dict(listed.labels)
    )
