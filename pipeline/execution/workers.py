"""Executes concrete scenarios in spawned worker processes; the results do not depend on the number of workers."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from pipeline.artefacts.files import program_sha256, sha256
from pipeline.config.components import make_detector, make_simulator
from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.core.space import Value
from pipeline.errors import InputError, SimulationError
from pipeline.execution import journal
from pipeline.execution.journal import Outcome
from pipeline.protocols import Detector, Simulator
from pipeline.scenarios.functional import FunctionalScenario


@dataclass(frozen=True)
class Execution:
    """One test to execute: its index, the path of its outcome, and the concrete scenario."""

    index: int
    path: Path
    concrete: Mapping[str, Value]


@dataclass(frozen=True)
class Setup:
    """What every process executes tests with.

    simulator, detector: sections of the config. model: the detector's file. keep_every: see `Simulator.execute`.
    """

    simulator: Mapping[str, Any]
    scenario: FunctionalScenario
    detector: Mapping[str, Any]
    model: Path
    car: Car
    keep_every: int = 0

    @property
    def identity(self) -> str:
        """Digest of everything that the outcome of a test depends on, beside its concrete scenario."""
        settings = [self.simulator, self.scenario.model_dump(), self.detector, asdict(self.car), self.keep_every]
        return hashlib.sha256(json.dumps([settings, sha256(self.model), program_sha256()], sort_keys=True).encode()).hexdigest()


_setup: Setup


class Workers:
    """A pool of processes, each with its own simulator and detector."""

    def __init__(self, count: int, setup: Setup) -> None:
        self._count, self._setup = count, setup
        self._pool: ProcessPoolExecutor | None = None

    def execute(self, jobs: Sequence[Execution]) -> Iterator[int]:
        """Execute the jobs, in any order; yields the index of each when its outcome is written.

        If a process dies (out of memory, a crash in the driver), the unfinished tests of all processes are executed again, one at a time; a
        test that kills its process a second time becomes an error.
        """
        futures: dict[Future[None], Execution] = {}
        try:
            futures = {self._started(self._count).submit(_execute, job): job for job in jobs}
            for future in as_completed(futures):
                future.result()
                yield futures[future].index
        except BrokenProcessPool:
            self.close()
            for job in jobs:
                if not job.path.exists():
                    self._alone(job)
                    yield job.index
            self.close()

    def _alone(self, job: Execution) -> None:
        try:
            self._started(1).submit(_execute, job).result()
        except BrokenProcessPool:
            self.close()
            journal.write(job.path, Outcome.error("the process of the simulation died"))

    def _started(self, count: int) -> ProcessPoolExecutor:
        if self._pool is None:
            # Spawned, because a forked child hangs if its parent has a GL context.
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(count, context, _prepare, (os.getpid(), self._setup))
        return self._pool

    def close(self) -> None:
        """End the processes."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None


def _prepare(parent: int, setup: Setup) -> None:
    global _setup
    _setup = setup
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent ends its workers after their current test.
    # With several threads, sums depend on their number; and the processes already share the cores.
    os.environ.update(OMP_NUM_THREADS="1", LP_NUM_THREADS="0")
    threadpool_limits(1)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


@cache
def _built() -> tuple[Simulator, Detector]:
    """This process's simulator and detector; the first test builds them, so that their errors reach the campaign."""
    simulator = make_simulator(_setup.simulator, _setup.scenario, _setup.car)
    return simulator, Guarded(make_detector(_setup.detector, _setup.model))


def _end_with(parent: int) -> None:
    """Exit when the parent is gone: a parent killed by kill -9 cannot end its workers."""
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)


class Guarded:
    """A detector that turns exceptions of foreign code into errors: they end one test, not the campaign."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector

    def detect(self, frame: Frame) -> Detections:
        """Return the detector's result; raises SimulationError for any exception except InputError, which ends the campaign."""
        try:
            return self._detector.detect(frame)
        except (InputError, SimulationError):
            raise
        except Exception as error:
            raise SimulationError(f"{type(self._detector).__name__}.detect failed: {type(error).__name__}: {error}") from error


def _execute(job: Execution) -> None:
    simulator, detector = _built()
    started = time.perf_counter()
    try:
        outcome = Outcome.of(simulator.execute(job.concrete, detector, _setup.keep_every), time.perf_counter() - started)
    except SimulationError as error:
        outcome = Outcome.error(str(error), time.perf_counter() - started)
    journal.write(job.path, outcome)
