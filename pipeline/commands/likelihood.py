"""Command `likelihood`: how likely a failure is under an exposure (thesis Def. 4.11 and 4.12).

It takes one scenario or several.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.artefacts.job_lock import held
from pipeline.artefacts.tables import is_valid
from pipeline.commands.campaign import (
    STOPPED,
    UNFINISHED,
    Search,
    check_folder,
    check_free,
    planned,
    read_whole,
    read_words,
    waiting,
)
from pipeline.config.arguments import whole
from pipeline.config.exposure import ExposureFile, read_exposure
from pipeline.config.project import typed
from pipeline.config.schema import AUDIT
from pipeline.core.identity import CampaignId
from pipeline.core.names import nearest
from pipeline.errors import InputError
from pipeline.progress import Progress
from pipeline.scenarios.parts import SEEDS

if TYPE_CHECKING:
    from pipeline.core.likelihood.rate import Rate
    from pipeline.core.space import Space
    from pipeline.execution.campaign import CampaignPlan, Executed

METHODS = {
    "monte_carlo": "pipeline.core.likelihood.monte_carlo.MonteCarlo",
    "subset": "pipeline.core.likelihood.subset.SubsetSimulation",
    "importance": "pipeline.core.likelihood.importance.ImportanceSampling",
}
WORDS = """scenario=F1,F2 (scenario=all: those of the exposure), exposure=town, method=monte_carlo
(subset, importance), budget=3000 for each scenario, seed=0, model=models/uniform, below=0.001
(monte_carlo stops once that is settled), out=FOLDER; and overrides of the default study"""
HELP = "Estimate how likely a failure is. Ctrl-C stops it; the same command resumes it."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("words", nargs="*", metavar="key=value", help=WORDS)
    parser.add_argument(
        "--threads", type=whole(1), default=2, help="worker processes (default: %(default)s)"
    )
    parser.add_argument(
        "--from",
        dest="folders",
        nargs="+",
        metavar="FOLDER",
        help="execute nothing; weight the tests of these `random` campaigns by the exposure",
    )


@dataclass(frozen=True)
class Question:
    """The question that a person asks.

    Attributes:
        scenario: names of scenarios with commas between them, or `all`.
        exposure: name in conf/exposure, or path of a YAML file.
        method: a key of METHODS.
        budget: number of tests of each scenario, at least 100.
        seed: seed of the estimator.
        model: folder of a model version.
        below: limit in (0, 1) at which Monte Carlo stops; None for no limit.
        out: folder for the results; None for one below data/by_hand.
        overrides: overrides of the default study.
    """

    scenario: str = "F1"
    exposure: str = "town"
    method: str = "monte_carlo"
    budget: int = 3000
    seed: int = 0
    model: Path = Path("models/uniform")
    below: float | None = None
    out: Path | None = None
    overrides: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        size = str(self.budget) if self.below is None else f"{self.budget}-below-{self.below:g}"
        parts = (Path(self.exposure).stem, self.method, self.model.name, str(self.seed), size)
        return self.out or Path("data/by_hand/likelihood", *parts)


def read_share(key: str, text: str) -> float:
    """A number in (0, 1); InputError that names the key for another text."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 < value < 1:
        raise InputError(f"{key} must be a number between 0 and 1, got '{text}'")
    return value


def read_method(key: str, text: str) -> str:
    """A key of METHODS; InputError for another text."""
    if text not in METHODS:
        raise InputError(f"{key}: there is no '{text}'{nearest(text, METHODS)}")
    return text


READ: dict[str, Callable[[str, str], Any]] = {
    "scenario": lambda _, text: text,
    "exposure": lambda _, text: str(typed(text)) if text.endswith((".yaml", ".yml")) else text,
    **dict.fromkeys(("model", "out"), lambda _, text: typed(text)),
    "method": read_method,
    "budget": partial(read_whole, least=100),
    "seed": partial(read_whole, least=0, most=SEEDS - 1),
    "below": read_share,
}
"""How each word is read, from its key and text; all others are overrides."""


def run(options: argparse.Namespace) -> int:
    """Estimate the rate of every scenario, print each and that of the system."""
    # A word may also stand after the folders of --from.
    after = options.folders or []
    late = [text for text in after if "=" in text and not typed(text).exists()]
    folders = [typed(text) for text in after if text not in late]
    words = [*options.words, *late]
    question = asked(words)
    for key in (word.partition("=")[0] for word in words):
        if folders and key not in ("exposure", "below"):
            raise InputError(
                f"{key}: --from executes nothing and weights the tests in its folders; "
                "leave the word out"
            )
    exposure = read_exposure(question.exposure)
    try:
        threads = options.threads
        rates = weighed(folders, exposure) if folders else executed(question, exposure, threads)
    except KeyboardInterrupt:
        print(f"\nstopped; finished tests are in {question.folder}, and the same command resumes")
        return STOPPED
    print(answer(rates, question, exposure))
    return 0


def asked(words: Sequence[str]) -> Question:
    """The question of some words; InputError for a wrong one."""
    question = Question(**read_words(words, READ))
    if question.below is not None and question.method != "monte_carlo":
        raise InputError(
            f"below: only monte_carlo stops once a limit is settled, got method={question.method}"
        )
    return question


def scenarios_of(question: Question, exposure: ExposureFile) -> list[str]:
    """The scenarios of a question; `all` stands for those that the exposure names.

    Raises:
        InputError: there is no scenario, or a scenario is named twice.
    """
    if question.scenario == "all":
        if exposure.scenarios is None:
            raise InputError(
                f"scenario=all: exposure '{question.exposure}' has no shares of scenarios, "
                "so name them, as in scenario=F1,F2"
            )
        return list(exposure.scenarios.shares)
    names = question.scenario.split(",")
    if len(set(names)) < len(names):
        raise InputError(f"scenario: expected distinct scenarios, got {question.scenario}")
    return names


def executed(question: Question, exposure: ExposureFile, threads: int) -> dict[str, Rate]:
    """Execute the tests of every scenario; a scenario that an earlier call has finished is read."""
    from pipeline.artefacts.likelihood import read_rate, write_rate
    from pipeline.execution.campaign import run_campaign

    names = scenarios_of(question, exposure)
    exposure.shares(names)
    for name in names:
        check_folder(question.folder / name, (*UNFINISHED, "rate.json"))
    plans = {name: plan_of(question, name, exposure) for name in names}
    rates: dict[str, Rate] = {}
    for name, plan in plans.items():
        folder, journal = question.folder / name, question.folder / name / "journal"
        with held(folder / "lock", waiting(folder)):
            file = folder / "rate.json"
            rate = read_rate(file, plan.identity)
            if rate is None:
                check_free(folder, plan.identity, "another" if file.exists() else None)
                with Progress(f"{name}, {question.method}") as progress:
                    done = run_campaign(plan, folder / "tests.parquet", journal, threads, progress)
                rate = rate_of(plan, done)
                write_rate(file, plan.identity, rate)
            shutil.rmtree(journal, ignore_errors=True)
        rates[name] = rate
    return rates


def plan_of(question: Question, scenario: str, exposure: ExposureFile) -> CampaignPlan:
    """The campaign that an estimator asks for."""
    names = scenarios_of(question, exposure)
    others = tuple(f"scenarios.{name}." for name in names if name != scenario)
    overrides = ["campaign.keep_every=0"]
    for word in question.overrides:
        key = word.lstrip("+~")
        if key.startswith("samplers."):
            raise InputError(
                f"{word}: an estimator chooses the tests, so no strategy counts; leave the word out"
            )
        if not key.startswith(others):
            overrides.append(word)
    search = Search(
        scenario=scenario,
        strategy=AUDIT,
        budget=question.budget,
        seed=question.seed,
        model=question.model,
        out=question.folder / scenario,
        overrides=tuple(overrides),
    )
    base = planned(search)
    if not base.setup.scenario.asks_to_brake:
        raise InputError(
            f"scenario: {scenario} asks the ego not to brake, "
            "and an estimator cannot learn from false activations"
        )
    exposure.of(scenario, base.space)
    campaign = CampaignId(scenario, question.method, question.model.name, question.seed)
    strategy = {
        "_target_": METHODS[question.method],
        "exposure": exposure.plain,
        "budget": question.budget,
        "failure_threshold_s": base.failure_threshold_s,
    }
    if question.below is not None:
        strategy["below"] = question.below
    return replace(base, campaign=campaign, strategy=strategy)


def rate_of(plan: CampaignPlan, done: Sequence[Executed]) -> Rate:
    """The rate of executed tests.

    An estimator's state is its history, so it learns the tests again.
    """
    import numpy as np

    from pipeline.core.kpi import told

    estimator: Any = plan.sampler()
    kpi = told(
        np.array([test.kpi.adj_ttc_s for test in done]),
        [test.kpi.failure for test in done],
        plan.failure_threshold_s,
    )
    number = 0
    while len(points := estimator.ask()[: len(done) - number]):
        estimator.tell(points, kpi[number : number + len(points)])
        number += len(points)
    rate: Rate = estimator.rate()
    return rate


def weighed(folders: Sequence[Path], exposure: ExposureFile) -> dict[str, Rate]:
    """The rates by scenario of campaigns of random tests, weighted by the exposure."""
    import pandas as pd

    from pipeline.artefacts.points import encode_tests
    from pipeline.artefacts.recorded_tests import tables_below
    from pipeline.artefacts.tables import read_tests, space_of_tests
    from pipeline.core.likelihood.reweighted import reweighted

    tables = {path: read_tests(path) for path in tables_below(folders)}
    for path, table in tables.items():
        for strategy in set(table["strategy"]) - {AUDIT}:
            raise InputError(
                f"{path}: expected tests of strategy '{AUDIT}', got '{strategy}': its tests are "
                "not uniform, independent samples of the space, so they give no rate"
            )
    tests = pd.concat(tables.values())
    if len(versions := sorted(set(tests["version"]))) > 1:
        raise InputError(f"--from: expected tests of one version, got {', '.join(versions)}")
    spaces: dict[str, Space] = {}
    for path, table in tables.items():
        for scenario in set(table["scenario"]):
            if spaces.setdefault(scenario, space := space_of_tests(path)) != space:
                raise InputError(
                    f"--from: expected tests of one space of {scenario}, got another one in {path}"
                )
    twice = tests[tests.duplicated("test_id")]
    if len(twice):
        raise InputError(
            f"--from: {twice.iloc[0]['test_id']} is in two of the tables; "
            "leave one of them out, since a test counts once"
        )
    rates = {}
    for scenario, rows in tests.groupby("scenario"):
        valid = rows[is_valid(rows)]
        if valid.empty:
            raise InputError(f"--from: {scenario} has no test without an error")
        space = spaces[str(scenario)]
        points, failed = encode_tests(valid, space), valid["failure"].to_numpy(bool)
        densities, errors = exposure.of(str(scenario), space), len(rows) - len(valid)
        rates[str(scenario)] = reweighted(densities, points, failed, errors)
    return rates


def answer(rates: Mapping[str, Rate], question: Question, exposure: ExposureFile) -> str:
    """The rates, the system's if there are several, and what they allow us to claim."""
    from pipeline.core.likelihood.rate import combined, sentence

    shares = exposure.shares(list(rates))
    lines = []
    for name, share in zip(rates, shares, strict=True):
        lines.append(line(f"{name} ({share:.0%})" if len(rates) > 1 else name, rates[name]))
    system = combined(list(rates.values()), shares)
    if len(rates) > 1:
        lines.append(line("system", replace(system, note="")))
    lines.append(sentence(system, Path(question.exposure).stem))
    if question.below is not None:
        lines.append(settled(system, question.below))
    return "\n".join(lines)


def line(name: str, rate: Rate) -> str:
    """One rate with its interval and counts."""
    counts = f"{rate.failures:,} of {rate.tests:,} tests fail"
    if rate.errors:
        counts += f", {rate.errors} errors"
    value = "unknown"
    if rate.limits.below < 1:
        interval = f"{rate.limits.low:.2g} to {rate.limits.high:.2g}"
        value = f"{rate.value:.2g}, 95 % interval {interval}"
    text = f"{name}: failure probability {value}; {counts}"
    return f"{text}\n  {rate.note}" if rate.note else text


def settled(rate: Rate, below: float) -> str:
    """Whether a rate is certainly below or above a limit."""
    if rate.limits.below < below:
        return f"settled: the rate is below {below:g}"
    if rate.limits.low > below:
        return f"settled: the rate is above {below:g}"
    return f"not settled: more tests must show whether the rate is below {below:g}"
