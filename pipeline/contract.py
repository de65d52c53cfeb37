"""A step's contract: the files that it reads and writes, the sections of the config that it depends on, whether it takes threads.

Snakemake's rules, DVC's stages and the command line are made from it. `perform` runs a step as a job and passes it only the declared items.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from string import Formatter

from pipeline.artefacts import stamps
from pipeline.artefacts.files import remove_unfinished, sha256, write_bytes
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.job_lock import held
from pipeline.config.declared import declared
from pipeline.config.schema import Config
from pipeline.errors import explained
from pipeline.progress import Progress

Wildcards = Mapping[str, str]
Files = str | Sequence[str]
"""One path, or several of a kind; a path that ends with a slash is a folder."""
Sections = tuple[str, ...] | Callable[[Config, Wildcards], tuple[str, ...]]
PATTERNS = {"seed": r"\d+"}
"""Regular expressions of wildcards that have the same form in every step."""
STAMP = "stamp"
WAITING = "the same job is already running, perhaps on another machine; waiting for it to finish"
VERDICT_FOLLOWS = "BLINDSPOT_VERDICT_FOLLOWS"
"""Set by a caller of Snakemake that prints the verdict itself."""
REFUSED = Path(".snakemake/refused")
"""Exists from the time a job of a run refuses its input until the next run."""


def _nothing(folders: Folders, wildcards: Wildcards) -> Mapping[str, Files]:
    return {}


@dataclass(frozen=True)
class Step:
    """The declaration of a step.

    help: one sentence for the command line. writes: named paths in a study's folders, with the job's wildcards in braces; the first name is
    one file. reads: named paths, given the wildcards. sections: dotted keys of the config, which may contain wildcards in braces.
    wildcards: regular expressions for wildcards with restricted values. parallel: whether it takes more than one thread. environment:
    variables that affect the result. parts: a step whose jobs share this step's work, if any: its code counts for what is out of date, but
    neither the number of its jobs nor their files, which are deleted after use.
    """

    help: str
    writes: Callable[[Folders], Mapping[str, Files]]
    sections: Sections
    reads: Callable[[Folders, Wildcards], Mapping[str, Files]] = _nothing
    wildcards: Mapping[str, str] = field(default_factory=dict)
    parallel: bool = False
    environment: tuple[str, ...] = ()
    parts: str | None = None

    def depends(self, config: Config, wildcards: Wildcards) -> tuple[str, ...]:
        """The keys of the config that a job depends on."""
        keys = self.sections(config, wildcards) if callable(self.sections) else self.sections
        return tuple(key.format(**wildcards) for key in keys)

    def outputs(self, folders: Folders) -> dict[str, Files]:
        """All files that a job writes, including its stamp."""
        named = dict(self.writes(folders))
        first = next(iter(named.values()))
        assert isinstance(first, str), "the first of a step's writes is one file"
        return {**named, STAMP: first + stamps.SUFFIX}

    def names(self, folders: Folders) -> tuple[str, ...]:
        """The wildcards that tell the step's jobs apart."""
        pattern = str(self.outputs(folders)[STAMP])
        return tuple(dict.fromkeys(name for _, name, _, _ in Formatter().parse(pattern) if name))


@dataclass(frozen=True)
class Job:
    """The arguments of a step. config: the declared sections alone. scratch: a folder that survives a kill and is not an output; `perform`
    removes it once the job is done."""

    config: Config
    wildcards: Wildcards
    reads: Mapping[str, Files]
    writes: Mapping[str, Files]
    threads: int
    progress: Progress
    scratch: Path

    def input(self, name: str) -> Path:
        """The one file or folder declared by that name."""
        return _one(self.reads[name])

    def inputs(self, name: str) -> tuple[Path, ...]:
        """The files declared by that name."""
        return _several(self.reads[name])

    def output(self, name: str) -> Path:
        """The one file or folder to write."""
        return _one(self.writes[name])

    def outputs(self, name: str) -> tuple[Path, ...]:
        """The files to write."""
        return _several(self.writes[name])

    def digests(self) -> dict[str, str]:
        """SHA-256 of every file and folder that the job reads, by path."""
        return {path.as_posix(): sha256(path) for name in self.reads for path in self.inputs(name)}


def _one(files: Files) -> Path:
    return Path(files if isinstance(files, str) else files[0])


def _several(files: Files) -> tuple[Path, ...]:
    return (Path(files),) if isinstance(files, str) else tuple(map(Path, files))


def step_of(name: str) -> Step:
    """The contract of a step."""
    step: Step = import_module(f"pipeline.steps.{name}").STEP
    return step


@dataclass(frozen=True)
class Order:
    """A job to perform: the step's name, its wildcards and files, and the stamp to write when it is done."""

    step: str
    wildcards: Wildcards
    reads: Mapping[str, Files]
    writes: Mapping[str, Files]
    stamp: str
    threads: int = 1
    log: Path | None = None


def perform(order: Order, config: Config) -> None:
    """Run a step on the declared part of the config, then write its stamp; `explained` errors go to the log and to the caller.

    A cluster's jobs live on when Snakemake is killed: if such a job is at work on the same files, wait for it and keep what it made.
    """
    scratch = Path(Folders(config).root, "journal", order.step, *order.wildcards.values())
    with (
        Progress(order.step, order.log) as progress,
        held(_lock(scratch), lambda: progress.note(WAITING)) as waited,
    ):
        if not (waited and _made(order)):
            _make(order, config, scratch, progress)
        # Not before the stamp is written, so that a kill until then loses no work.
        shutil.rmtree(scratch, ignore_errors=True)


def _make(order: Order, config: Config, scratch: Path, progress: Progress) -> None:
    part = declared(config, step_of(order.step).depends(config, order.wildcards))
    outputs = {name: files for name, files in order.writes.items() if name != STAMP}
    stamp = _one(order.writes[STAMP])
    stamps.withdraw(stamp)
    made = [path for files in outputs.values() for path in _several(files)]
    remove_unfinished([*made, stamp])
    job = Job(part, order.wildcards, order.reads, outputs, order.threads, progress, scratch)
    try:
        import_module(f"pipeline.steps.{order.step}").run(job)
    except Exception as error:
        if (told := explained(error)) is None:
            raise
        progress.record(str(told))
        raise told from error
    write_bytes(stamp, stamps.made(stamp, order.stamp, made).text().encode())


def _made(order: Order) -> bool:
    """Whether an order's files are made, with its stamp."""
    files = [path for paths in order.writes.values() for path in _several(paths)]
    found = stamps.read(_one(order.writes[STAMP]))
    return (
        found is not None and found.depends == order.stamp and all(path.exists() for path in files)
    )


def _lock(scratch: Path) -> Path:
    return scratch.with_name(f"{scratch.name}.lock")


def order_of(
    name: str, config: Config, wildcards: Wildcards, stamp: str, threads: int = 1
) -> Order:
    """The order for a job on the files of its study, equal to Snakemake's."""
    step, folders = step_of(name), Folders(config)
    outputs = {key: _filled(files, wildcards) for key, files in step.outputs(folders).items()}
    return Order(name, wildcards, step.reads(folders, wildcards), outputs, stamp, threads)


def _filled(files: Files, wildcards: Wildcards) -> Files:
    return (
        files.format(**wildcards)
        if isinstance(files, str)
        else [path.format(**wildcards) for path in files]
    )
