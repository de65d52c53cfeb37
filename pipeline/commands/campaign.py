"""Command `campaign`: one search by one strategy, live."""

from __future__ import annotations

import argparse
import difflib
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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

WORDS = """scenario=F1 strategy=forest budget=300 seed=0 model=models/uniform out=FOLDER, all optional; and overrides of the default
study, such as campaign.match_iou=0.3 +samplers.forest.explore=0.2"""
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
HELP = "Search a scenario for failures with one strategy. Ctrl-C stops it; the same command resumes it."


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("words", nargs="*", metavar="key=value", help=WORDS)
    parser.add_argument(
        "--threads", type=whole(1), default=2, help="worker processes (default: %(default)s)"
    )


@dataclass(frozen=True)
class Search:
    """What a person asks for. overrides: of the default study."""

    scenario: str = "F1"
    strategy: str = "forest"
    budget: int = 300
    seed: int = 0
    model: Path = Path("models/uniform")
    out: Path | None = None
    overrides: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        return self.out or Path(
            "data/by_hand", self.scenario, self.strategy, self.model.name, str(self.seed)
        )


def number(least: int, most: int = MOST) -> Callable[[str, str], int]:
    """Reads a word's whole number from `least` to `most`; InputError that names the key for another text."""

    def read(key: str, text: str) -> int:
        try:
            return whole(least, most)(text)
        except argparse.ArgumentTypeError as error:
            raise InputError(f"{key}: {error}") from error

    return read


READ: dict[str, Callable[[str, str], Any]] = {
    "scenario": lambda _, text: text,
    "strategy": lambda _, text: text,
    "budget": number(1),
    "seed": number(0, SEEDS - 1),
    "model": lambda _, text: typed(text),
    "out": lambda _, text: typed(text),
}
"""How each word of our own is read, from its key and text; all others are overrides."""


def run(options: argparse.Namespace) -> int:
    """Execute the campaign with its progress, write its tables and print what was found."""
    search = asked(options.words)
    check_folder(search.folder, (*UNFINISHED, f"tests.parquet{SUFFIX}"))
    plan = planned(search)
    with held(search.folder / "lock", waiting(search.folder)):
        return _run(search, plan, options.threads)


def waiting(folder: Path) -> Callable[[], None]:
    """Says that another process uses a folder."""
    return lambda: print(
        f"{folder}: waiting for another process that executes tests there", file=sys.stderr
    )


def _run(search: Search, plan: CampaignPlan, threads: int) -> int:
    from pipeline.artefacts import stamps
    from pipeline.artefacts.files import write_bytes
    from pipeline.execution.campaign import run_campaign

    tests, journal = search.folder / "tests.parquet", search.folder / "journal"
    stamp = search.folder / f"{tests.name}{stamps.SUFFIX}"
    made = stamps.read(stamp)
    check_free(search.folder, plan.identity, made.depends if made else None)
    if made is not None and all((search.folder / name).exists() for name in made.digests):
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
    write_bytes(
        stamp,
        stamps.made(stamp, plan.identity, [tests.with_name(f"{name}.parquet") for name in TABLES])
        .text()
        .encode(),
    )
    shutil.rmtree(journal, ignore_errors=True)
    print(summary(plan, done))
    print(f"tables: {search.folder}/tests.parquet, signals, detections, frames and timings")
    return 0


# A killed export leaves a temporary file.
UNFINISHED = ("lock", "journal", "*.onnx", ".*.onnx.*.tmp")
"""Files in the folder of a search before it has tables."""


def check_folder(folder: Path, ours: Sequence[str]) -> None:
    """InputError for a folder with files, none of which is ours, before anything is written there."""
    found = list(folder.iterdir()) if folder.is_dir() else []
    if found and not any(entry.match(own) for entry in found for own in ours):
        raise InputError(_foreign(folder, found))


def check_free(folder: Path, identity: str, finished: str | None) -> None:
    """InputError unless a folder is new or holds the search of this identity. finished: the identity of a finished search in it."""
    from pipeline.execution.journal import identity_of

    found = finished or identity_of(folder / "journal")
    if found not in (None, identity):
        raise InputError(
            f"{folder} holds another search, or one by other code; choose another folder with out=, or delete this one"
        )
    others = [entry for entry in folder.iterdir() if not any(map(entry.match, UNFINISHED))]
    if found is None and others:
        raise InputError(_foreign(folder, others))


def _foreign(folder: Path, found: Sequence[Path]) -> str:
    return f"{folder}: expected a new folder or that of a search, got one with {min(found).name}; choose another with out="


def asked(words: Sequence[str]) -> Search:
    """The search of some words; InputError for a wrong one."""
    return Search(**read_words(words, READ))


def read_words(
    words: Sequence[str], readers: Mapping[str, Callable[[str, str], Any]]
) -> dict[str, Any]:
    """Values by key, and other words as `overrides`; InputError for a wrong one. readers: how each key is read, from key and text."""
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
        elif "." not in key and (
            meant := difflib.get_close_matches(key, list(readers), n=1, cutoff=0.7)
        ):
            raise InputError(f"unknown key '{key}'; did you mean '{meant[0]}'?")
        else:
            overrides.append(word)
    return {**values, "overrides": tuple(overrides)}


def planned(search: Search) -> CampaignPlan:
    """The campaign of a search; exports its detector into the search's folder."""
    from pipeline.detectors.yolo.export import onnx_of
    from pipeline.execution.campaign import CampaignPlan
    from pipeline.execution.workers import Setup

    config = study_of(search.scenario, search.overrides)
    if search.strategy not in config.samplers:
        raise InputError(
            f"strategy: there is no '{search.strategy}'{nearest(search.strategy, config.samplers)}"
        )
    _check_used(search)
    campaign = CampaignId(search.scenario, search.strategy, search.model.name, search.seed)
    return CampaignPlan(
        campaign=campaign,
        space=config.space(search.scenario),
        tests=search.budget,
        failure_threshold_s=config.campaign.failure_threshold_s,
        strategy=config.samplers[search.strategy],
        setup=Setup.of(
            config,
            search.scenario,
            onnx_of(search.model, search.folder),
            keep_every=config.campaign.keep_every,
        ),
    )


def _check_used(search: Search) -> None:
    """InputError for an override that the campaign does not use."""
    used = (f"scenarios.{search.scenario}", f"samplers.{search.strategy}", *USED)
    for word in search.overrides:
        key = word.lstrip("+~").partition("=")[0]
        if not any(key == own or key.startswith(f"{own}.") for own in used):
            raise InputError(
                f"{key}: the tests of this command do not depend on it; of a study's settings, it uses {', '.join(used)}"
            )


def summary(plan: CampaignPlan, done: Sequence[Executed]) -> str:
    """Failures, their kinds, causes and pairs of categories; errors apart."""
    failed = [test for test in done if test.kpi.failure]
    errors = sum(test.outcome.is_error for test in done)
    judged = len(done) - errors
    lines = [f"{len(failed)} of {judged} tests fail{f', {errors} errors' if errors else ''}"]
    if failed:
        points = np.array([test.point for test in failed])
        causes = ", ".join(
            f"{cause} {count}"
            for cause, count in Counter(test.kpi.cause for test in failed).most_common()
        )
        lines.append(
            f"{kinds_of(plan.space, points)} kinds (combinations of person and pose); causes: {causes}"
        )
        lines.append(
            f"the failures cover {pair_coverage(plan.space, points):.1%} of all pairs of categories"
        )
    return "\n".join(lines)
