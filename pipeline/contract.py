"""A step's contract: the files it reads and writes, the config it depends on, its threads.

Snakemake's rules and the command line are made from it, and dvc.yaml is compared with it.
`perform` runs a step as a job and passes it only the declared items.
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
Reads = Callable[[Folders, Wildcards], Mapping[str, Files]]
Sections = tuple[str, ...] | Callable[[Config, Wildcards], tuple[str, ...]]
PATTERNS = {"seed": r"\d+"}
"""Regular expressions of wildcards that have the same form in every step."""
STAMP = "stamp"
WAITING = "the same job is already running, perhaps on another machine; waiting for it to finish"
VERDICT_FOLLOWS = "BLINDSPOT_VERDICT_FOLLOWS"
"""Set by a caller of Snakemake that prints the verdict itself."""
REJECTED = Path(".snakemake/rejected")
"""Exists from the time a job of a run rejects its input until the next run."""


@dataclass(frozen=True)
class Step:
    """The declaration of a step. A module of pipeline/steps assigns it to `STEP`.

    Attributes:
        help: one sentence for the command line.
        writes: named paths in a study's folders, with the job's wildcards in braces. The first
            name is one file; the job's stamp lies beside it.
        sections: dotted keys of the config that the outputs depend on, such as `comparison.alpha`
            or `scenarios.{scenario}`; a tuple, or a function of the config and the wildcards.
        reads: named paths, given the wildcards; by default none.
        wildcards: regular expressions of the wildcards with restricted values.
        parallel: whether the step takes more than one thread.
        environment: environment variables that affect the outputs.
        parts: name of a step whose jobs share this step's work, if any. Its code counts for what
            is out of date, but neither the number of its jobs nor their files, which are deleted
            after use.
    """

    help: str
    writes: Callable[[Folders], Mapping[str, Files]]
    sections: Sections
    reads: Reads = field(default=lambda folders, wildcards: {})
    wildcards: Mapping[str, str] = field(default_factory=dict)
    parallel: bool = False
    environment: tuple[str, ...] = ()
    parts: str | None = None

    def depends(self, config: Config, wildcards: Wildcards) -> tuple[str, ...]:
        """The dotted keys of the config that a job depends on, without wildcards."""
        keys = self.sections(config, wildcards) if callable(self.sections) else self.sections
        return tuple(key.format(**wildcards) for key in keys)

    def outputs(self, folders: Folders) -> dict[str, Files]:
        """All files that a job writes, by name; the last is its stamp."""
        files = dict(self.writes(folders))
        first = next(iter(files.values()))
        assert isinstance(first, str), "the first of a step's writes is one file"
        return {**files, STAMP: first + stamps.SUFFIX}

    def names(self, folders: Folders) -> tuple[str, ...]:
        """The wildcards that distinguish the step's jobs, in the order of the path."""
        fields = Formatter().parse(str(self.outputs(folders)[STAMP]))
        return tuple(dict.fromkeys(name for _, name, _, _ in fields if name))


@dataclass(frozen=True)
class Job:
    """The argument of a step's `run`.

    Attributes:
        config: the declared sections alone; any other key raises AttributeError.
        wildcards: values by name, such as `{"scenario": "F1", "seed": "0"}`.
        reads, writes: the declared paths by name, without wildcards; writes has no stamp.
        threads: the most threads that the step may use, at least 1.
        progress: shows how far the job is.
        scratch: a folder for unfinished work. It survives a kill and is not an output; `perform`
            removes it once the job is done.
    """

    config: Config
    wildcards: Wildcards
    reads: Mapping[str, Files]
    writes: Mapping[str, Files]
    threads: int
    progress: Progress
    scratch: Path

    def input(self, name: str) -> Path:
        """The one file or folder to read that the step declares by this name."""
        return paths_of(self.reads[name])[0]

    def inputs(self, name: str) -> tuple[Path, ...]:
        """The files to read that the step declares by this name."""
        return paths_of(self.reads[name])

    def output(self, name: str) -> Path:
        """The one file or folder to write that the step declares by this name."""
        return paths_of(self.writes[name])[0]

    def outputs(self, name: str) -> tuple[Path, ...]:
        """The files to write that the step declares by this name."""
        return paths_of(self.writes[name])

    def digests(self) -> dict[str, str]:
        """SHA-256 of every file and folder that the job reads, by path."""
        return {path.as_posix(): sha256(path) for name in self.reads for path in self.inputs(name)}


@dataclass(frozen=True)
class Order:
    """A job to perform.

    Attributes:
        step: name of the step, such as `render_base`.
        wildcards, reads, writes: as in Job, but writes includes the job's stamp.
        stamp: the text of the stamp to write when the job is done.
        threads: the most threads that the step may use, at least 1.
        log: file for the job's messages, if any.
    """

    step: str
    wildcards: Wildcards
    reads: Mapping[str, Files]
    writes: Mapping[str, Files]
    stamp: str
    threads: int = 1
    log: Path | None = None


def paths_of(files: Files) -> tuple[Path, ...]:
    """The paths behind a declared name, one or several."""
    return (Path(files),) if isinstance(files, str) else tuple(map(Path, files))


def step_of(name: str) -> Step:
    """The contract of a step."""
    step: Step = import_module(f"pipeline.steps.{name}").STEP
    return step


def order_of(
    name: str, config: Config, wildcards: Wildcards, stamp: str, threads: int = 1
) -> Order:
    """The order for a job on the files of its study, equal to Snakemake's.

    Args:
        name: name of the step.
        config: the config of the study.
        wildcards: a value for each of the step's wildcards.
        stamp: the text of the stamp to write when the job is done.
        threads: the most threads that the step may use, at least 1.
    """
    step, folders = step_of(name), Folders(config)
    writes: dict[str, Files] = {}
    for key, files in step.outputs(folders).items():
        if isinstance(files, str):
            writes[key] = files.format(**wildcards)
        else:
            writes[key] = [path.format(**wildcards) for path in files]
    return Order(name, wildcards, step.reads(folders, wildcards), writes, stamp, threads)


def perform(order: Order, config: Config) -> None:
    """Run a step on the declared part of the config, then write its stamp.

    The jobs of a cluster live on when Snakemake is killed. If such a job is working on the same
    files, wait for it and keep its files.

    Args:
        order: the job.
        config: the config of the whole study.

    Raises:
        InputError: the input is bad, or the machine lacks room, rights or handles. The message is
            also in the job's log.
        NoResultError: all tests of a campaign ended in an error.
    """
    scratch = Path(Folders(config).root, "journal", order.step, *order.wildcards.values())
    lock = scratch.with_name(f"{scratch.name}.lock")
    with (
        Progress(order.step, order.log) as progress,
        held(lock, lambda: progress.note(WAITING)) as waited,
    ):
        if not (waited and is_done(order)):
            _run(order, config, scratch, progress)
        # Not before the stamp is written, so that a kill until then loses no work.
        shutil.rmtree(scratch, ignore_errors=True)


def is_done(order: Order) -> bool:
    """Whether an order's files are there, with its stamp."""
    stamp = stamps.read(paths_of(order.writes[STAMP])[0])
    if stamp is None or stamp.depends != order.stamp:
        return False
    return all(path.exists() for files in order.writes.values() for path in paths_of(files))


def _run(order: Order, config: Config, scratch: Path, progress: Progress) -> None:
    """Remove the job's old stamp and unfinished files, run the step and write the stamp."""
    part = declared(config, step_of(order.step).depends(config, order.wildcards))
    outputs = {name: files for name, files in order.writes.items() if name != STAMP}
    paths = [path for files in outputs.values() for path in paths_of(files)]
    stamp = paths_of(order.writes[STAMP])[0]
    stamps.withdraw(stamp)
    remove_unfinished([*paths, stamp])
    job = Job(part, order.wildcards, order.reads, outputs, order.threads, progress, scratch)
    try:
        import_module(f"pipeline.steps.{order.step}").run(job)
    except Exception as error:
        explanation = explained(error)
        if explanation is None:
            raise
        progress.record(str(explanation))
        raise explanation from error
    write_bytes(stamp, stamps.made(stamp, order.stamp, paths).text().encode())
