"""Command `campaign`: one search by one strategy, live."""

from __future__ import annotations

import argparse
import difflib
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.artefacts.job_lock import held
from pipeline.artefacts.stamps import SUFFIX
from pipeline.artefacts.tables import TABLES
from pipeline.config.arguments import whole
from pipeline.config.composing import study_of
from pipeline.config.project import typed
from pipeline.core.identity import CampaignId
from pipeline.core.measures import kinds_of, pair_coverage
from pipeline.core.names import nearest
from pipeline.errors import InputError
from pipeline.progress import Progress
from pipeline.scenarios.parts import MOST, SEEDS

if TYPE_CHECKING:
    from pipeline.execution.campaign import CampaignPlan, Executed

WORDS = """scenario=F1 strategy=forest budget=300 seed=0 model=models/uniform out=FOLDER, all
optional; and overrides of the default study, such as campaign.match_iou=0.3
+samplers.forest.explore=0.2"""
USED = (
    "simulator",
    "camera",
    "detector",
    "vehicle",
    "aeb",
    "limits",
    "campaign.match_iou",
    "campaign.failure_threshold_s",
    "campaign.keep_every",
)
"""The settings of a study that decide what a test does and what is kept of it."""
STOPPED = 130
"""Exit code after Ctrl-C, as in a shell."""
HELP = "Search a scenario for failures with a strategy. Ctrl-C stops it; the same command resumes."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("words", nargs="*", metavar="key=value", help=WORDS)
    parser.add_argument(
        "--threads", type=whole(1), default=2, help="worker processes (default: %(default)s)"
    )


@dataclass(frozen=True)
class Search:
    """The search that a person asks for.

    Attributes:
        scenario, strategy: names in conf/.
        budget: number of tests, at least 1.
        seed: seed of the strategy.
        model: folder of a model version.
        out: folder for the results; None for one below data/by_hand.
        overrides: overrides of the default study.
    """

    scenario: str = "F1"
    strategy: str = "forest"
    budget: int = 300
    seed: int = 0
    model: Path = Path("models/uniform")
    out: Path | None = None
    overrides: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        parts = (self.scenario, self.strategy, self.model.name, str(self.seed))
        return self.out or Path("data/by_hand", *parts)


def read_whole(key: str, text: str, least: int, most: int = MOST) -> int:
    """A whole number from `least` to `most`; InputError that names the key for another text."""
    try:
        return whole(least, most)(text)
    except argparse.ArgumentTypeError as error:
        raise InputError(f"{key}: {error}") from error


READ: dict[str, Callable[[str, str], Any]] = {
    "scenario": lambda _, text: text,
    "strategy": lambda _, text: text,
    "budget": partial(read_whole, least=1),
    "seed": partial(read_whole, least=0, most=SEEDS - 1),
    "model": lambda _, text: typed(text),
    "out": lambda _, text: typed(text),
}
"""How each word is read, from its key and text; all others are overrides."""


def run(options: argparse.Namespace) -> int:
    """Execute the campaign with its progress, write its tables and print a summary."""
    search = asked(options.words)
    check_folder(search.folder, (*UNFINISHED, f"tests.parquet{SUFFIX}"))
    plan = planned(search)
    with held(search.folder / "lock", waiting(search.folder)):
        return execute(search, plan, options.threads)


def waiting(folder: Path) -> Callable[[], None]:
    """A function that reports that another process uses a folder."""
    message = f"{folder}: waiting for another process that executes tests there"
    return lambda: print(message, file=sys.stderr)


def execute(search: Search, plan: CampaignPlan, threads: int) -> int:
    """Execute a search in its folder, unless it is finished; returns the exit code."""
    from pipeline.artefacts import stamps
    from pipeline.artefacts.files import write_bytes
    from pipeline.execution.campaign import run_campaign

    tests, journal = search.folder / "tests.parquet", search.folder / "journal"
    stamp = search.folder / f"{tests.name}{stamps.SUFFIX}"
    finished = stamps.read(stamp)
    check_free(search.folder, plan.identity, finished.depends if finished else None)
    if finished is not None and all((search.folder / name).exists() for name in finished.digests):
        shutil.rmtree(journal, ignore_errors=True)  # A killed run may have left it.
        print(f"{tests} has this search already; delete {search.folder} to execute it again")
        return 0
    stamps.withdraw(stamp)
    try:
        with Progress(f"{search.scenario}, {search.strategy}") as progress:
            done = run_campaign(plan, tests, journal, threads, progress)
    except KeyboardInterrupt:
        print(f"\nstopped; finished tests are in {journal}, and the same command resumes")
        return STOPPED
    tables = [tests.with_name(f"{name}.parquet") for name in TABLES]
    write_bytes(stamp, stamps.made(stamp, plan.identity, tables).text().encode())
    shutil.rmtree(journal, ignore_errors=True)
    print(summary(plan, done))
    print(f"tables: {search.folder}/tests.parquet, signals, detections, frames and timings")
    return 0


# A killed export leaves a temporary file.
UNFINISHED = ("lock", "journal", "*.onnx", ".*.onnx.*.tmp")
"""Files in the folder of a search before it has tables."""


def check_folder(folder: Path, patterns: Sequence[str]) -> None:
    """InputError for a folder with files, none of which matches a pattern of a search's files."""
    entries = list(folder.iterdir()) if folder.is_dir() else []
    if entries and not any(any(map(entry.match, patterns)) for entry in entries):
        raise _foreign(folder, entries)


def check_free(folder: Path, identity: str, finished: str | None) -> None:
    """Check that a folder is new or holds this search.

    Args:
        folder: the folder of the search.
        identity: the identity of the search.
        finished: the identity of a finished search in the folder, if any.

    Raises:
        InputError: the folder holds another search, or files of something else.
    """
    from pipeline.execution.journal import identity_of

    present = finished or identity_of(folder / "journal")
    if present not in (None, identity):
        raise InputError(
            f"{folder} holds another search, or one by other code; "
            "choose another folder with out=, or delete this one"
        )
    others = [entry for entry in folder.iterdir() if not any(map(entry.match, UNFINISHED))]
    if present is None and others:
        raise _foreign(folder, others)


def _foreign(folder: Path, entries: Sequence[Path]) -> InputError:
    return InputError(
        f"{folder}: expected a new folder or that of a search, got one with {min(entries).name}; "
        "choose another with out="
    )


def asked(words: Sequence[str]) -> Search:
    """The search of some words; InputError for a wrong one."""
    return Search(**read_words(words, READ))


def read_words(
    words: Sequence[str], readers: Mapping[str, Callable[[str, str], Any]]
) -> dict[str, Any]:
    """Values by key, and other words as `overrides`.

    Args:
        words: texts such as `budget=300`.
        readers: for each key, a function of the key and the text.

    Raises:
        InputError: a word is no key=value, has a wrong value, or repeats or misspells a key.
    """
    values: dict[str, Any] = {}
    overrides: list[str] = []
    for word in words:
        key, equals, value = word.partition("=")
        if not equals:
            raise InputError(f"expected key=value, got '{word}'")
        if key in values:
            raise InputError(f"{key} is given twice: {values[key]} and {value}")
        if key in readers:
            values[key] = readers[key](key, value)
            continue
        similar = difflib.get_close_matches(key, list(readers), n=1, cutoff=0.7)
        if similar and "." not in key:
            raise InputError(f"unknown key '{key}'; did you mean '{similar[0]}'?")
        overrides.append(word)
    return {**values, "overrides": tuple(overrides)}


def planned(search: Search) -> CampaignPlan:
    """The campaign of a search; exports its detector into the search's folder."""
    from pipeline.detectors.yolo.export import onnx_of
    from pipeline.execution.campaign import CampaignPlan
    from pipeline.execution.workers import Setup

    scenario, strategy = search.scenario, search.strategy
    config = study_of(scenario, search.overrides)
    if strategy not in config.samplers:
        raise InputError(f"strategy: there is no '{strategy}'{nearest(strategy, config.samplers)}")
    used = (f"scenarios.{scenario}", f"samplers.{strategy}", *USED)
    for word in search.overrides:
        key = word.lstrip("+~").partition("=")[0]
        if not f"{key}.".startswith(tuple(f"{section}." for section in used)):
            raise InputError(f"{key}: has no effect here; this command only uses {', '.join(used)}")
    model = onnx_of(search.model, search.folder)
    return CampaignPlan(
        campaign=CampaignId(scenario, strategy, search.model.name, search.seed),
        space=config.space(scenario),
        tests=search.budget,
        failure_threshold_s=config.campaign.failure_threshold_s,
        strategy=config.samplers[strategy],
        setup=Setup.of(config, scenario, model, keep_every=config.campaign.keep_every),
    )


def summary(plan: CampaignPlan, done: Sequence[Executed]) -> str:
    """Failures, their kinds, causes and pairs of categories; errors apart."""
    failed = [test for test in done if test.kpi.failure]
    errors = sum(test.outcome.is_error for test in done)
    judged = len(done) - errors
    lines = [f"{len(failed)} of {judged} tests fail{f', {errors} errors' if errors else ''}"]
    if failed:
        points = np.array([test.point for test in failed])
        counts = Counter(test.kpi.cause for test in failed).most_common()
        causes = ", ".join(f"{cause} {count}" for cause, count in counts)
        kinds = kinds_of(plan.space, points)
        lines.append(f"{kinds} kinds (combinations of person and pose); causes: {causes}")
        covered = pair_coverage(plan.space, points)
        lines.append(f"the failures cover {covered:.1%} of all pairs of categories")
    return "\n".join(lines)
