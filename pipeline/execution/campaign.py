"""One campaign: ask a strategy, execute its tests, tell it the results, write the tables."""

from __future__ import annotations

import hashlib
import json
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from pipeline.artefacts import stamps, tables
from pipeline.artefacts.files import sha256
from pipeline.artefacts.points import encode_tests
from pipeline.config.components import make_sampler
from pipeline.core.identity import CampaignId, TestId
from pipeline.core.kpi import NO_KPI, Kpi, told
from pipeline.core.measures import kinds
from pipeline.core.names import count_of
from pipeline.core.shards import Shard
from pipeline.core.signals import SIGNALS
from pipeline.core.space import Floats, Space, Value
from pipeline.errors import InputError, NoResultError
from pipeline.execution.journal import Journal, Outcome
from pipeline.execution.workers import Execution, Setup, Workers
from pipeline.progress import Progress
from pipeline.protocols import Sampler


@dataclass(frozen=True)
class CampaignPlan:
    """What a campaign executes.

    strategy: its section of the config. earlier: tests.parquet of the campaigns that its strategy
    learns from. shard: the part to execute, if the strategy does not learn; None is the whole
    campaign. frozen: see `sampler_seed`.
    """

    campaign: CampaignId
    space: Space
    tests: int
    failure_threshold_s: float
    strategy: Mapping[str, Any]
    setup: Setup
    earlier: Sequence[Path] = ()
    shard: Shard | None = None
    frozen: bool = False

    @property
    def strategy_seed(self) -> int:
        """The seed of its sampler."""
        return sampler_seed(self.campaign, self.frozen)

    @property
    def indices(self) -> range:
        """The indices of the tests to execute."""
        return range(self.tests) if self.shard is None else self.shard.tests(self.tests)

    @property
    def identity(self) -> str:
        """Digest of everything that the campaign's tests depend on."""
        # A strategy's tests depend on what it is told.
        learnt = [self.failure_threshold_s, *(sha256(path) for path in self.earlier)]
        parts = [self.setup.identity, self.strategy, self.strategy_seed, self.tests, learnt]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def sampler(self) -> Sampler:
        """The strategy before its first test."""
        history = {}
        if self.earlier:
            threshold_s = self.failure_threshold_s
            history["earlier"] = [_history(path, self.space, threshold_s) for path in self.earlier]
        return make_sampler(self.strategy, self.space, self.strategy_seed, **history)


@dataclass(frozen=True)
class Executed:
    """One test of a campaign.

    Attributes:
        index: of the test.
        batch: of the strategy.
        point: (d,) in the space.
        concrete: the point, decoded.
        outcome: of its execution.
        kpi: of the outcome.
        sampler_s: time that choosing it took.
    """

    index: int
    batch: int
    point: Floats
    concrete: Mapping[str, Value]
    outcome: Outcome
    kpi: Kpi
    sampler_s: float


@dataclass
class _Tally:
    """What a search has achieved so far, counted test by test for its progress."""

    space: Space
    tests: int = 0
    failures: int = 0
    kinds: set[tuple[float, ...]] = field(default_factory=set)

    def add(self, test: Executed) -> None:
        self.tests += 1
        if test.kpi.failure:
            self.failures += 1
            self.kinds |= kinds(self.space, test.point[None])

    def __str__(self) -> str:
        failures, kinds = count_of(self.failures, "failure"), count_of(len(self.kinds), "kind")
        return f"{failures} ({self.failures / self.tests:.0%}), {kinds}"


def sampler_seed(campaign: CampaignId, frozen: bool = False) -> int:
    """The seed of a campaign's sampler, in [0, 2³¹).

    Scenarios share a space and most strategies begin with random tests: with equal seeds, campaigns
    would share tests, and their results would not be independent.

    Args:
        campaign: its scenario, strategy, version and seed.
        frozen: all versions get the same tests, as on the held-out sequence, so the version does
            not count.
    """
    named = [
        campaign.scenario,
        campaign.strategy,
        None if frozen else campaign.version,
        campaign.seed,
    ]
    return int.from_bytes(hashlib.sha256(json.dumps(named).encode()).digest()[:4], "big") >> 1


def run_campaign(
    plan: CampaignPlan, out: Path, journal: Path, threads: int, progress: Progress
) -> list[Executed]:
    """Execute a campaign, write its five tables and return its tests.

    Args:
        plan: what to execute.
        out: path of tests.parquet; signals, detections, frames and timings.parquet are beside it.
        journal: folder of the finished tests of an unfinished campaign; the same plan resumes from
            it, and the caller removes it.
        threads: worker processes; they change no table but the timings.
        progress: reports each finished test.

    Raises:
        InputError: if the strategy asks for no test.
        NoResultError: if every test ended in an error. Neither is raised for a shard, because its
            campaign may have a result.
    """
    log, sampler = Journal(journal, plan.identity, progress), plan.sampler()
    with closing(Workers(threads, plan.setup)) as workers:
        done = search(plan, sampler, log, workers, progress)
    errors = [test.outcome.reason for test in done if test.outcome.is_error]
    if plan.shard is None and len(errors) == len(done):
        log.remove()  # Errors that a person has to mend first are not resumed.
        raise no_result(plan.campaign, errors)
    write(plan, done, out)
    return done


def no_result(campaign: CampaignId, reasons: Sequence[str]) -> InputError | NoResultError:
    """The error of a campaign without a valid test.

    reasons: of the errors of its tests, none if it has no tests.
    """
    named = f"{campaign.scenario}, {campaign.strategy}, {campaign.version}, seed {campaign.seed}"
    if not reasons:
        return InputError(f"{named}: expected at least one test, the strategy asks for none")
    (reason, count), *_ = Counter(reasons).most_common()
    return NoResultError(
        f"{named}: all {len(reasons)} tests ended in an error, so there is no result; "
        f"{count} times: {reason}"
    )


def search(
    plan: CampaignPlan, sampler: Sampler, log: Journal, workers: Workers, progress: Progress
) -> list[Executed]:
    """Ask, execute the tests missing from the journal and tell, until the campaign ends."""
    done: list[Executed] = []
    tally, number, batch = _Tally(plan.space), 0, 0
    while number < plan.indices.stop:
        started = time.perf_counter()
        with threadpool_limits(1):  # With several threads, sums depend on their number.
            points = sampler.ask()[: plan.tests - number]
        if not len(points):
            break
        seconds = (time.perf_counter() - started) / len(points)
        asked = [index for index in range(number, number + len(points)) if index in plan.indices]
        concretes = {index: plan.space.decode(points[index - number]) for index in asked}
        judged: dict[int, Executed] = {}
        for index in _finished(concretes, log, workers):
            outcome = log.read(index)
            judged[index] = Executed(
                index,
                batch,
                points[index - number],
                concretes[index],
                outcome,
                outcome.kpi(plan.failure_threshold_s),
                seconds,
            )
            tally.add(judged[index])
            progress(tally.tests, len(plan.indices), str(tally))
        # The tests of other shards have no result here.
        results = [
            judged[index].kpi if index in judged else NO_KPI
            for index in range(number, number + len(points))
        ]
        kpi = np.array([result.adj_ttc_s for result in results])
        failures = [result.failure for result in results]
        sampler.tell(points, told(kpi, failures, plan.failure_threshold_s))
        done += [judged[index] for index in asked]
        number, batch = number + len(points), batch + 1
    return done


def _finished(
    concretes: Mapping[int, Mapping[str, Value]], log: Journal, workers: Workers
) -> Iterator[int]:
    """Yield the index of each test once its outcome is in the journal: those of earlier runs first.

    concretes: of the tests, by index.
    """
    resumed, jobs = [], []
    for index, concrete in concretes.items():
        if log.holds(index, concrete):
            resumed.append(index)
        else:
            jobs.append(Execution(index, log.path(index), concrete))
    yield from chain(resumed, workers.execute(jobs))


def write(plan: CampaignPlan, done: Sequence[Executed], out: Path) -> None:
    """Write the five tables of a campaign; `out` is tests.parquet."""
    named = [(str(TestId(plan.campaign, test.index)), test) for test in done]
    rows: dict[str, list[dict[str, Any]]] = {"tests": [], "frames": [], "timings": []}
    steps: dict[str, list[pd.DataFrame]] = {"signals": [], "detections": []}
    for name, test in named:
        outcome = test.outcome
        rows["tests"].append({"test_id": name, **_test_row(plan, test)})
        rows["frames"] += [{"test_id": name, **frame} for frame in outcome.frames]
        seconds = {"sampler_s": test.sampler_s, "simulate_s": outcome.simulate_s}
        rows["timings"].append({"test_id": name, **seconds})
        if not outcome.is_error:
            signals = {signal.name: outcome.signals[signal.name] for signal in SIGNALS}
            table = pd.DataFrame(signals)
            table.insert(0, "test_id", name)
            table.insert(1, "step", range(len(table)))
            steps["signals"].append(table)
        if len(outcome.detections["step"]):
            columns = [column.name for column in tables.DETECTIONS[1:]]
            table = pd.DataFrame({column: outcome.detections[column] for column in columns})
            table.insert(0, "test_id", name)
            steps["detections"].append(table)
    written = {name: pd.DataFrame(table) for name, table in rows.items()}
    for name, parts in steps.items():
        written[name] = pd.concat(parts) if parts else pd.DataFrame()
    tables.write_campaign(out, written.__getitem__, plan.space)


def join(campaign: CampaignId, shards: Sequence[Path], space: Space, out: Path) -> None:
    """Write the five tables of a campaign from its shards', equal to those of one without shards.

    Without a valid test, raises what `run_campaign` does and withdraws the stamps of the shards.

    Args:
        campaign: scenario, strategy, version and seed.
        shards: their paths of tests.parquet, in order.
        space: of the scenario.
        out: path of tests.parquet.
    """
    tests = tables.read_campaigns(shards, "tests")
    if (~tables.is_valid(tests)).all():
        for shard in shards:  # Errors that a person has to mend first are executed again.
            stamps.withdraw(shard.with_name(shard.name + stamps.SUFFIX))
        raise no_result(campaign, list(tests["reason"]))
    tables.write_campaign(out, lambda name: tables.read_campaigns(shards, name), space)


def _history(path: Path, space: Space, failure_threshold_s: float) -> tuple[Floats, Floats]:
    """The points and KPIs of a campaign's tests, as its sampler received them."""
    tests = tables.read_tests(path)
    return encode_tests(tests, space), told(
        tests["adj_ttc_s"].to_numpy(float), tests["failure"], failure_threshold_s
    )


def _test_row(plan: CampaignPlan, test: Executed) -> dict[str, Any]:
    place = {"index": test.index, "batch": test.batch}
    status = {"status": test.outcome.status, "reason": test.outcome.reason}
    return {
        **asdict(plan.campaign),
        **place,
        **status,
        **asdict(test.kpi),
        **test.concrete,
    }
