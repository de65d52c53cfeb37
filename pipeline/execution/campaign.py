"""One campaign: ask a strategy, execute its tests in closed loop, tell it the results, write the tables."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hydra.utils import instantiate
from threadpoolctl import threadpool_limits

from pipeline.artefacts import tables
from pipeline.artefacts.files import program_sha256, sha256
from pipeline.artefacts.points import encode_tests
from pipeline.core.columns import Column
from pipeline.core.identity import CampaignId
from pipeline.core.kpi import NO_KPI, Kpi, evaluate
from pipeline.core.signals import SIGNALS
from pipeline.core.space import Floats, Space
from pipeline.execution.journal import Journal, Outcome
from pipeline.execution.workers import Execution, Setup, Workers
from pipeline.progress import Progress
from pipeline.protocols import Sampler


@dataclass(frozen=True)
class CampaignPlan:
    """What a campaign executes. strategy: for Hydra to instantiate. earlier: tests.parquet of the campaigns that its strategy learns
    from."""

    campaign: CampaignId
    space: Space
    tests: int
    failure_threshold_s: float
    strategy: Mapping[str, Any]
    strategy_seed: int
    setup: Setup
    earlier: Sequence[Path] = ()

    @property
    def identity(self) -> str:
        """Digest of everything that the campaign's tests depend on."""
        setup, strategy = self.setup, (self.strategy, self.strategy_seed, self.tests)
        settings = [setup.simulator, setup.scenario.model_dump(), setup.detector, *strategy, setup.keep_every]
        files = [sha256(setup.model), [sha256(path) for path in self.earlier], program_sha256()]
        return hashlib.sha256(json.dumps([settings, *files], sort_keys=True).encode()).hexdigest()

    def sampler(self) -> Sampler:
        """The strategy before its first test."""
        history = {"earlier": [_history(path, self.space) for path in self.earlier]} if self.earlier else {}
        # Partial, because Hydra would turn the space, a dataclass, into a config.
        made: Sampler = instantiate(self.strategy, _partial_=True, _convert_="all")(space=self.space, seed=self.strategy_seed, **history)
        return made


@dataclass(frozen=True)
class Executed:
    """One test of a campaign: its point in the space, its outcome, and the seconds that choosing it took."""

    point: Floats
    outcome: Outcome
    kpi: Kpi
    sampler_s: float


def sampler_seed(scenario: str, seed: int, version: str = "base") -> int:
    """The seed of a campaign's sampler, derived from scenario, version and seed. Scenarios share a space, so with equal seeds they would
    all get the same tests: eight campaigns of 120 would be 120 different tests. The same holds for the search against a retrained
    version, which was trained on them."""
    name = scenario if version == "base" else f"{scenario} {version}"
    return int.from_bytes(hashlib.sha256(f"{name} {seed}".encode()).digest()[:4], "big") >> 1


def run_campaign(plan: CampaignPlan, out: Path, journal: Path, threads: int, progress: Progress) -> None:
    """Execute a campaign and write tests, signals, frames and timings.parquet beside `out`, which is tests.parquet.

    journal: folder of the finished tests of an unfinished campaign; the same plan resumes from it. threads: worker processes; they change
    no table but the timings.
    """
    log = Journal(journal, plan.identity)
    if log.discarded:
        progress.note("the journal belonged to another configuration, model or code and was discarded")
    sampler, workers = plan.sampler(), Workers(threads, plan.setup)
    try:
        done = search(plan, sampler, log, workers, progress)
    finally:
        workers.close()
    write(plan, done, out)
    log.remove()


def search(plan: CampaignPlan, sampler: Sampler, log: Journal, workers: Workers, progress: Progress) -> list[Executed]:
    """Ask, execute the tests missing from the journal, tell, until the budget is spent."""
    done: list[Executed] = []
    while len(done) < plan.tests:
        started = time.perf_counter()
        with threadpool_limits(1):  # With several threads, sums depend on their number.
            points = sampler.ask()[: plan.tests - len(done)]
        seconds = (time.perf_counter() - started) / len(points)
        first = len(done)
        asked = [Execution(index, log.path(index), plan.space.decode(point)) for index, point in enumerate(points, first)]
        jobs = [execution for execution in asked if execution.index not in log]
        finished, found = first + len(points) - len(jobs), f"{_failures(done)} failures"
        progress(finished, plan.tests, found)
        for count, _ in enumerate(workers.execute(jobs), finished + 1):
            progress(count, plan.tests, found)
        batch = [_judged(point, log.read(first + i), seconds, plan.failure_threshold_s) for i, point in enumerate(points)]
        sampler.tell(points, np.array([test.kpi.adj_ttc_s for test in batch]))
        done += batch
    progress(plan.tests, plan.tests, f"{_failures(done)} failures")
    return done


def write(plan: CampaignPlan, done: Sequence[Executed], out: Path) -> None:
    """Write the four tables of a campaign; `out` is tests.parquet."""
    ids = [str(test) for test in plan.campaign.tests(len(done))]
    named = list(zip(ids, done, strict=True))
    signals = [_signal_rows(name, test.outcome) for name, test in named if not test.outcome.is_error]
    frames = [{"test_id": name, **row} for name, test in named for row in test.outcome.frames]
    timings = [{"test_id": name, "sampler_s": test.sampler_s, "simulate_s": test.outcome.simulate_s} for name, test in named]
    tests = [{"test_id": name, **_test_row(plan, i, test)} for i, (name, test) in enumerate(named)]
    tables.write_signals(out.with_name("signals.parquet"), pd.concat(signals) if signals else _empty(tables.SIGNAL_TABLE))
    tables.write_frames(out.with_name("frames.parquet"), pd.DataFrame(frames) if frames else _empty(tables.FRAMES))
    tables.write_timings(out.with_name("timings.parquet"), pd.DataFrame(timings))
    tables.write_tests(out, pd.DataFrame(tests), plan.space)


def _history(path: Path, space: Space) -> tuple[Floats, Floats]:
    """The points and KPIs of a campaign's tests, as its sampler received them."""
    tests = tables.read_tests(path)
    return encode_tests(tests, space), tests["adj_ttc_s"].to_numpy(float)


def _judged(point: Floats, outcome: Outcome, sampler_s: float, threshold_s: float) -> Executed:
    judged = NO_KPI if outcome.is_error else evaluate(outcome.signals, threshold_s)
    return Executed(point, outcome, judged, sampler_s)


def _failures(done: Sequence[Executed]) -> int:
    return sum(test.kpi.failure for test in done)


def _empty(expected: Sequence[Column]) -> pd.DataFrame:
    return pd.DataFrame(columns=[column.name for column in expected])


def _test_row(plan: CampaignPlan, index: int, test: Executed) -> dict[str, Any]:
    place = {"index": index, "batch": index // int(plan.strategy.get("batch_size", 20))}
    status = {"status": "error" if test.outcome.is_error else "ok", "reason": test.outcome.reason}
    return {**asdict(plan.campaign), **place, **status, **asdict(test.kpi), **plan.space.decode(test.point)}


def _signal_rows(test_id: str, outcome: Outcome) -> pd.DataFrame:
    table = pd.DataFrame({signal.name: outcome.signals[signal.name] for signal in SIGNALS})
    table.insert(0, "test_id", test_id)
    table.insert(1, "step", range(len(table)))
    return table
