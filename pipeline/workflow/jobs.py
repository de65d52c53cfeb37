"""The jobs of a study: the files of each, and the order in which they need each other."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pkgutil import iter_modules

from snakemake.io import regex_from_filepattern

from pipeline import steps
from pipeline.artefacts.folders import Folders
from pipeline.config.schema import Config
from pipeline.contract import PATTERNS, Files, Step, Wildcards, step_of
from pipeline.errors import InputError

STAGES = {
    "spaces": ("space",),
    "base_set": ("base_set",),
    "base": ("models",),
    "search": ("campaigns",),
    "analysis": ("measures.json", "theta.csv", "white_box.json", "regions", "filter"),
    "versions": ("retrained",),
    "held_out": ("held_out",),
    "compare": ("comparison.json", "comparison.parquet", "changes.csv", "metrics"),
    "pages": ("report.html", "plots", "evidence"),
    "track": ("tracking.json",),
}
"""Parts of a study: the files and folders of each, relative to the study's folder.

They are targets of Snakemake and stages of DVC. A part that is named after a step holds the files
of that step's only job: as a target, its name is Snakemake's rule."""


@dataclass(frozen=True)
class Target:
    """A job: a step and its wildcards."""

    step: str
    wildcards: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, step: str, wildcards: Wildcards) -> Target:
        return cls(step, tuple(sorted(wildcards.items())))


@dataclass(frozen=True)
class Jobs:
    """The jobs of a study.

    Attributes:
        config: the config of the study.
        steps: the names of all steps, in the order of the data flow.
    """

    config: Config
    steps: tuple[str, ...]

    def __post_init__(self) -> None:
        if self.config.goal == "report" and not self.config.campaign.keep_every:
            raise InputError(
                "campaign.keep_every must be at least 1, got 0: no frame would be left to train on"
            )

    @cached_property
    def folders(self) -> Folders:
        return Folders(self.config)

    @cached_property
    def contracts(self) -> dict[str, Step]:
        return {name: step_of(name) for name in self.steps}

    @property
    def constraints(self) -> dict[str, str]:
        """The possible values of wildcards in every rule."""
        choices = self.config.wildcards.items()
        return {name: "|".join(values) for name, values in choices} | PATTERNS

    def maker(self, path: str) -> Target | None:
        """The job that makes a file; None if no step does."""
        for name, pattern in self._patterns:
            if match := pattern.fullmatch(path):
                return Target.of(name, match.groupdict())
        return None

    @cached_property
    def _patterns(self) -> list[tuple[str, re.Pattern[str]]]:
        """The step and the regular expression of every declared output."""
        patterns = []
        for name, step in self.contracts.items():
            limits = {**self.constraints, **step.wildcards}
            limited = {}
            for wildcard in step.names(self.folders):
                limited[wildcard] = f"{{{wildcard},{limits.get(wildcard, '[^/]+')}}}"
            for path in flat(step.outputs(self.folders)):
                expression = regex_from_filepattern(path.format(**limited))
                patterns.append((name, re.compile(expression)))
        return patterns

    def inputs(self, target: Target) -> list[str]:
        """The paths that a job reads."""
        return flat(self.contracts[target.step].reads(self.folders, dict(target.wildcards)))

    def outputs(self, target: Target) -> list[str]:
        """The paths that a job writes; the last is its stamp."""
        return [
            path.format(**dict(target.wildcards))
            for path in flat(self.contracts[target.step].outputs(self.folders))
        ]

    def in_order(self) -> Iterator[tuple[Target, list[str]]]:
        """Every job of the study with its outputs, after the jobs that it depends on."""
        seen: set[Target] = set()

        def visit(path: str) -> Iterator[tuple[Target, list[str]]]:
            target = self.maker(path)
            if target is None or target in seen:
                return
            seen.add(target)
            for read in self.inputs(target):
                yield from visit(read)
            yield target, self.outputs(target)

        for goal in self.folders.goals:
            yield from visit(goal)

    @cached_property
    def parts(self) -> dict[str, list[tuple[Target, list[str]]]]:
        """The jobs of each of `STAGES`, each with its outputs."""
        stage_of = {root: stage for stage, roots in STAGES.items() for root in roots}
        parts: dict[str, list[tuple[Target, list[str]]]] = {stage: [] for stage in STAGES}
        for job, outputs in self.in_order():
            root = outputs[0].removeprefix(f"{self.folders.root}/").split("/")[0]
            if root in stage_of:
                parts[stage_of[root]].append((job, outputs))
        return parts

    @property
    def targets(self) -> dict[str, list[str]]:
        """The files of the parts that are not named after a step."""
        targets: dict[str, list[str]] = {}
        for name, jobs in self.parts.items():
            if name not in self.steps:
                targets[name] = [path for _, outputs in jobs for path in outputs]
        return targets


def step_names() -> tuple[str, ...]:
    """The names of all steps."""
    return tuple(sorted(module.name for module in iter_modules(steps.__path__)))


def flat(files: Mapping[str, Files]) -> list[str]:
    """All paths of named files."""
    every: list[str] = []
    for paths in files.values():
        every += [paths] if isinstance(paths, str) else paths
    return every
