"""Turns the steps' contracts into Snakemake's rules: a job's files, log and stamp, and the jobs of a study."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any, NoReturn

from snakemake.io import ancient, directory, regex_from_filepattern, report, temp
from snakemake.settings.types import DAGSettings

from pipeline import steps
from pipeline.artefacts import stamps
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.run_lock import hold
from pipeline.artefacts.stamp_parts import differences, remember
from pipeline.config.components import check_components
from pipeline.config.composing import load, of_snakemake
from pipeline.config.declared import value_at
from pipeline.config.schema import Config
from pipeline.contract import REFUSED, VERDICT_FOLLOWS, Files, Step, Wildcards, step_of
from pipeline.core.lineage import BASE
from pipeline.errors import InputError, one_line
from pipeline.report.catalogue import entry
from pipeline.sources import code_digest, source_digests

if TYPE_CHECKING:
    from snakemake.workflow import Workflow

STAGES = {
    "spaces": ("space",),
    "base_set": ("base_set",),
    "base": ("models",),
    "search": ("campaigns",),
    "analysis": ("measures.json", "theta.csv", "white_box.json", "regions", "filter"),
    "versions": ("retrained",),
    "held_out": ("held_out",),
    "compare": ("comparison.json", "comparison.parquet", "changes.csv", "metrics"),
    "report": ("report.html", "plots", "evidence"),
    "track": ("tracking.json",),
}
"""Parts of a study: the files and folders of each, relative to the study's folder. They are targets of Snakemake and stages of DVC."""
REASONS = Path(".snakemake/reasons")
"""Inputs of jobs that are out of date, named after what changed: always newer than the outputs."""
SHOWN = 3
"""Largest number of such inputs of a job."""
LOCKS = Path(".snakemake/locks")
"""Snakemake's own locks, which outlive a killed run."""


@dataclass(frozen=True)
class Target:
    """A job: a step and its wildcards."""

    step: str
    wildcards: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Plan:
    """The study of a config, as Snakemake needs it.

    steps: the names of all steps, in the order of the data flow. stored: whether the files are in one of Snakemake's storages. begin:
    called before any file is looked at.
    """

    config: Config
    steps: tuple[str, ...]
    stored: bool = False
    begin: Callable[[], None] = lambda: None
    _stamps: dict[Target, str] = field(default_factory=dict)
    _old: dict[Target, bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.config.goal == "report" and not self.config.campaign.keep_every:
            raise InputError("campaign.keep_every must be at least 1, or no frame is left to train on, got 0")

    @cached_property
    def folders(self) -> Folders:
        return Folders(self.config)

    @cached_property
    def contracts(self) -> dict[str, Step]:
        return {name: step_of(name) for name in self.steps}

    @property
    def constraints(self) -> dict[str, str]:
        """The possible values of wildcards in every rule."""
        config = self.config
        return {
            "scenario": "|".join(config.scenarios),
            "strategy": "|".join(config.samplers),
            "version": "|".join(dict.fromkeys([BASE, *map(str, config.versions)])),
            "seed": r"\d+",
        }

    def reads(self, name: str) -> Callable[[Any], dict[str, Any]]:
        """The input function of a step's rule.

        Stamps decide what is out of date. The inputs' times do not count for a job that is up to date; any other job reads a file that
        is always newer. In a storage, Snakemake's own records decide.
        """

        def read(wildcards: Mapping[str, str]) -> dict[str, Any]:
            self.begin()
            target = Target(name, tuple(sorted(wildcards.items())))
            files = dict(self.contracts[name].reads(self.folders, dict(target.wildcards)))
            if self.stored:
                return files
            if self.out_of_date(target):
                # Only through inputs that are not ancient does Snakemake see that a job follows one that runs again.
                return {**files, **self._changed(target)}
            return {key: ancient(paths) if isinstance(paths, str) else list(map(ancient, paths)) for key, paths in files.items()}

        return read

    def writes(self, name: str) -> dict[str, Any]:
        """The outputs of a step's rule; pages and plots go into Snakemake's own report, files of parts are deleted after use."""
        outputs = self.contracts[name].outputs(self.folders)
        flag = temp if name in {step.parts for step in self.contracts.values()} else _flagged
        return {key: flag(paths) if isinstance(paths, str) else list(map(flag, paths)) for key, paths in outputs.items()}

    def log(self, name: str, suffix: str) -> str:
        """The path of a job's log or benchmark."""
        wildcards = self.contracts[name].names(self.folders)
        return "/".join(["logs", self.config.study, name, *(f"{{{w}}}" for w in wildcards)]) + suffix

    def stamp(self, name: str, wildcards: Wildcards) -> str:
        """Digest of everything that determines a job's outputs: code, declared config, environment, and the stamps of its inputs."""
        target = Target(name, tuple(sorted(wildcards.items())))
        if target not in self._stamps:
            self._stamps[target] = self._digest(name, wildcards)
        return self._stamps[target]

    def _digest(self, name: str, wildcards: Wildcards) -> str:
        step = self.contracts[name]
        sections = {key: self.value(key) for key in step.depends(self.config, wildcards)}
        environment = {variable: os.environ.get(variable, "") for variable in step.environment}
        own = [sections, dict(wildcards), environment]
        digest = hashlib.sha256(json.dumps(own, sort_keys=True).encode())
        parts = {key: _short(value) for key, value in (*_leaves(sections), *environment.items())}
        for module in sorted(self.modules(name, sections)):
            digest.update((code := code_digest(module)).encode())
            parts[f"the code of {module}"] = code
            remember(code, source_digests(module))
        for path in flat(step.reads(self.folders, wildcards)):
            made = self.maker(path)
            if made is None or made.step != step.parts:
                digest.update(f"{path} {(origin := self._origin(path))}\n".encode())
                parts[path] = origin
        remember(stamp := digest.hexdigest()[:16], parts)
        return stamp

    def modules(self, name: str, sections: Any) -> set[str]:
        """The modules of ours that a step's outputs depend on, given the values of its sections of the config."""
        return {f"pipeline.steps.{step}" for step in (name, self.contracts[name].parts) if step} | targets_in(sections)

    def value(self, key: str) -> Any:
        """The plain value at a dotted key of the config."""
        return value_at(self._plain, key)

    @cached_property
    def _plain(self) -> dict[str, Any]:
        return self.config.model_dump(mode="json")

    def _origin(self, path: str) -> str:
        """The stamp of the job that makes a file, else the digest of its content."""
        made = self.maker(path)
        if made is not None:
            return self.stamp(made.step, dict(made.wildcards))
        return hashlib.sha256(Path(path).read_bytes()).hexdigest() if Path(path).is_file() else "missing"

    def maker(self, path: str) -> Target | None:
        """The job that makes a file; None if no step does."""
        for name, pattern in self._patterns:
            if found := pattern.fullmatch(path):
                return Target(name, tuple(sorted(found.groupdict().items())))
        return None

    @cached_property
    def _patterns(self) -> list[tuple[str, re.Pattern[str]]]:
        found = []
        for name, step in self.contracts.items():
            limits = {**self.constraints, **step.wildcards}
            for path in flat(step.outputs(self.folders)):
                found.append((name, re.compile(_expression(path, limits))))
        return found

    def out_of_date(self, target: Target) -> bool:
        """Whether a job has to run: its stamp is not today's, or a job before it runs again."""
        if target not in self._old:
            makers = dict.fromkeys(map(self.maker, self._inputs(target)))
            again = (self._made(job) and self.out_of_date(job) for job in makers if job is not None)
            self._old[target] = not self._has_its_stamp(target) or any(again)
        return self._old[target]

    def _has_its_stamp(self, target: Target) -> bool:
        found = stamps.read(Path(self._outputs(target)[-1]))
        return found is not None and found.depends == self.stamp(target.step, dict(target.wildcards))

    def _made(self, target: Target) -> bool:
        return any(Path(path).exists() for path in self._outputs(target))

    def _inputs(self, target: Target) -> list[str]:
        return flat(self.contracts[target.step].reads(self.folders, dict(target.wildcards)))

    def _outputs(self, target: Target) -> list[str]:
        """The paths that a job writes; the last is its stamp."""
        return [path.format(**dict(target.wildcards)) for path in flat(self.contracts[target.step].outputs(self.folders))]

    def _changed(self, target: Target) -> dict[str, list[str]]:
        """The inputs that make Snakemake run a job again, and show why; none where the job has made nothing yet."""
        if not self._made(target):
            return {}
        names = self.reasons(target)
        more = [f"and_{len(names) - SHOWN}_more"] if len(names) > SHOWN else []
        marks = [REASONS / re.sub(r"[^\w./-]", "_", name) for name in (*names[:SHOWN], *more)]
        for mark in marks:
            mark.parent.mkdir(parents=True, exist_ok=True)
            mark.write_text(str(time.time_ns()))  # A newer file with the same content would not count.
        return {"changed": list(map(str, marks))}

    def reasons(self, target: Target) -> Sequence[str]:
        """Why a job is out of date: the keys, variables and files that changed since its files were made."""
        found = stamps.read(Path(self._outputs(target)[-1]))
        now = self.stamp(target.step, dict(target.wildcards))
        if found is None:
            return ("no_stamp",)
        if found.depends == now:
            return ("an_input_is_made_again",)
        return differences(found.depends, now) or ("other_settings_or_code",)

    def jobs(self, goals: Sequence[str]) -> Iterator[tuple[Target, list[str]]]:
        """Every job that the given files need, each with its outputs; the jobs that it depends on come before it."""
        seen: set[Target] = set()

        def visit(path: str) -> Iterator[tuple[Target, list[str]]]:
            target = self.maker(path)
            if target is None or target in seen:
                return
            seen.add(target)
            for read in self._inputs(target):
                yield from visit(read)
            yield target, self._outputs(target)

        for goal in goals:
            yield from visit(goal)

    @cached_property
    def parts(self) -> dict[str, list[tuple[Target, list[str]]]]:
        """The jobs of each of `STAGES`, each with its outputs."""
        where = {root: stage for stage, roots in STAGES.items() for root in roots}
        found: dict[str, list[tuple[Target, list[str]]]] = {stage: [] for stage in STAGES}
        for job, outputs in self.jobs(self.folders.goals):
            root = outputs[0].removeprefix(f"{self.folders.root}/").split("/")[0]
            if root in where:
                found[where[root]].append((job, outputs))
        return found

    @property
    def targets(self) -> dict[str, list[str]]:
        """The files of the parts that are not named after a step."""
        return {name: [path for _, outputs in jobs for path in outputs] for name, jobs in self.parts.items() if name not in self.steps}

    def stamps(self, name: str) -> Callable[[Any], str]:
        """The stamp of a rule's job, by its wildcards."""
        return lambda wildcards: self.stamp(name, dict(wildcards.items()))

    def finish(self, asked: DAGSettings) -> None:
        """Print the verdict after a run of the whole study, or of its last step; in a storage, its files are not at hand."""
        targets = set(asked.targets)
        part = self.stored or (targets and not targets & {"all", "track"} and not targets >= set(self.folders.goals))
        if part or asked.until or asked.omit_from or asked.allowed_rules or asked.batch or VERDICT_FOLLOWS in os.environ:
            return
        subprocess.run([sys.executable, "-m", "pipeline", "verdict"], check=False)


def fail() -> None:
    """Exit with 2 after a run in which a job refused its input; other failures leave Snakemake's exit code, 1."""
    if REFUSED.exists():
        sys.exit(2)


def step_names() -> tuple[str, ...]:
    """The names of all steps."""
    return tuple(sorted(module.name for module in iter_modules(steps.__path__)))


def checked(params: str) -> str:
    """The path of a valid params.yaml; an error is one line instead of Snakemake's stack trace."""
    try:
        load(Path(params))
    except InputError as error:
        _end(error)
    return params


def plan(config: Mapping[str, Any], workflow: Workflow, steps: Sequence[str]) -> Plan:
    """The plan of Snakemake's config: params.yaml with the changes from the command line."""
    stored = workflow.storage_settings.default_storage_provider is not None
    try:
        checked = of_snakemake(config)
        _check_source(checked, workflow)
        check_components(checked)
        return Plan(checked, tuple(steps), stored, cache(lambda: alone(workflow)))
    except InputError as error:
        _end(error)


def _check_source(config: Config, workflow: Workflow) -> None:
    """InputError if the command line changes the study: the verdict, DVC and all commands read params.yaml. A study that has one in its own
    folder, as those of test-detector, may be named by it."""
    if not workflow.is_main_process:
        return
    given = workflow.config_settings
    own = Path(Folders(config).root, "params.yaml").absolute()
    named = "--config" if given.config else next(("--configfile" for path in given.configfiles if Path(path).absolute() != own), "")
    if named:
        instead = "type: python -m pipeline compose study=NAME key=value, then ./run"
        raise InputError(f"{named} would change only a part of the study; {instead}")


def alone(workflow: Workflow) -> None:
    """Wait for another run in this folder, if this one executes jobs; a lock that is left then is a killed run's."""
    if not workflow.is_main_process or workflow.executor_plugin is None or workflow.dryrun:
        return
    hold("snakemake")
    REFUSED.unlink(missing_ok=True)
    for left in LOCKS.glob("*.lock"):
        left.unlink()


def _end(error: InputError) -> NoReturn:
    print(f"error: {one_line(error)}", file=sys.stderr)
    sys.exit(2)


def _flagged(path: str) -> Any:
    if path.endswith("/"):
        return directory(path)
    if not path.endswith((".html", ".png")):
        return path
    listed = entry(path)
    return report(path, caption=listed.caption, category=listed.category, labels=dict(listed.labels))


def flat(files: Mapping[str, Files]) -> list[str]:
    """All paths of named files."""
    return [path for paths in files.values() for path in ([paths] if isinstance(paths, str) else paths)]


def _leaves(plain: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested mappings by their dotted keys."""
    if not isinstance(plain, dict) or not plain:
        yield prefix, plain
        return
    for key, value in plain.items():
        yield from _leaves(value, f"{prefix}.{key}" if prefix else str(key))


def _short(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:12]


def _expression(pattern: str, limits: Mapping[str, str]) -> str:
    """The regular expression of a path with wildcards in braces."""
    limited = re.sub(r"\{(\w+)\}", lambda found: f"{{{found[1]},{limits.get(found[1], '[^/]+')}}}", pattern)
    return str(regex_from_filepattern(limited))


def targets_in(plain: Any) -> set[str]:
    """Modules of ours that `_target_` names anywhere in plain data."""
    if isinstance(plain, dict):
        own = {plain["_target_"].rpartition(".")[0]} if str(plain.get("_target_", "")).startswith("pipeline.") else set()
        return own.union(*(targets_in(value) for value in plain.values()))
    return set()
