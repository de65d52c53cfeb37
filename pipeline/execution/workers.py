"""Executes concrete scenarios in worker processes.

The results do not depend on the number of workers.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.artefacts.calibration_results import DetectorCalibration, read_calibration
from pipeline.artefacts.files import program_sha256, sha256
from pipeline.artefacts.folders import Folders
from pipeline.config.components import make_detector, make_world
from pipeline.config.schema import Config
from pipeline.config.sections import Limits
from pipeline.core.car import Car
from pipeline.core.episode import Episode
from pipeline.core.space import Value
from pipeline.detectors.calibrated import as_tested
from pipeline.errors import InputError, SimulationError
from pipeline.execution import journal
from pipeline.execution.guarded import GuardedDetector, GuardedTests
from pipeline.execution.journal import Outcome
from pipeline.execution.worker import Broken, Calls, Pool
from pipeline.scenarios.functional import FunctionalScenario


@dataclass(frozen=True)
class Execution:
    """One test to execute.

    Args:
        index: number of the test in its campaign.
        path: file for its outcome.
        concrete: the concrete scenario.
        noise: scenario that seeds the random noise; None means this one.
    """

    index: int
    path: Path
    concrete: Mapping[str, Value]
    noise: Mapping[str, Value] | None = None


@dataclass(frozen=True)
class Setup:
    """What every process executes tests with.

    Args:
        simulator: section of the config.
        scenario: the functional scenario.
        detector: section of the config.
        model: the detector's file.
        car: the car's constants.
        limits: of a test.
        keep_every: see `pipeline.core.loop.run_test`.
    """

    simulator: Mapping[str, Any]
    scenario: FunctionalScenario
    detector: Mapping[str, Any]
    model: Path
    car: Car
    limits: Limits
    keep_every: int = 0

    @staticmethod
    def of(
        config: Config,
        scenario: str,
        model: Path,
        calibration: DetectorCalibration | None = None,
        *,
        keep_every: int = 0,
    ) -> Setup:
        """The setup of a study's scenario.

        Args:
            scenario: its name.
            model: the detector's file.
            calibration: of the model, if the study calibrates it.
            keep_every: see `pipeline.core.loop.run_test`.
        """
        detector = as_tested(config.detector, calibration)
        return Setup(
            config.simulator,
            config.scenarios[scenario],
            detector,
            model,
            config.car,
            config.limits,
            keep_every,
        )

    @staticmethod
    def recorded(folders: Folders, scenario: str, version: str, *, keep_every: int = 0) -> Setup:
        """The setup with which a study tested a version, with the calibration of that time."""
        calibration = read_calibration(folders.calibrations([version]))
        return Setup.of(
            folders.config,
            scenario,
            Path(folders.detector(version)),
            calibration,
            keep_every=keep_every,
        )

    @property
    def identity(self) -> str:
        """Digest of all that a test's outcome depends on, except its concrete scenario."""
        settings = [
            self.simulator,
            self.scenario.model_dump(),
            self.detector,
            asdict(self.car),
            self.limits.model_dump(),
            self.keep_every,
        ]
        return hashlib.sha256(
            json.dumps([settings, sha256(self.model), program_sha256()], sort_keys=True).encode()
        ).hexdigest()


class Workers:
    """A pool of processes, each with its own world and detector."""

    def __init__(self, count: int, setup: Setup) -> None:
        self._pool: Pool[Execution, None] = Pool(count, partial(_executor, setup), setup.limits)

    def execute(self, jobs: Sequence[Execution]) -> Iterator[int]:
        """Execute the jobs, in any order; yields the index of each when its outcome is written.

        A test whose process breaks is an error; see `Pool.run` for those that are executed again
        first.
        """
        for number, result in self._pool.run(jobs):
            job = jobs[number]
            # A process that dies after it wrote an outcome does not report it.
            if isinstance(result, Broken) and not job.path.exists():
                journal.write(job.path, Outcome.error(result.reason), job.concrete)
            yield job.index

    def close(self) -> None:
        """End the processes, also those at work."""
        self._pool.close()


def guarded(setup: Setup, calls: Calls) -> GuardedTests:
    """What executes the tests of one process: a world and a detector of its own."""
    world = make_world(setup.simulator, setup.scenario, setup.car.vehicle)
    detector = GuardedDetector(make_detector(setup.detector, setup.model), calls)
    return GuardedTests(world, detector, setup.car, setup.keep_every)


def _executor(setup: Setup, calls: Calls) -> Callable[[Execution], None]:
    tests = guarded(setup, calls)

    def execute(job: Execution) -> None:
        started = time.perf_counter()
        try:
            episode = tests.run(job.concrete, job.noise)
            outcome = Outcome.of(episode, time.perf_counter() - started)
        except SimulationError as error:
            outcome = Outcome.error(str(error), time.perf_counter() - started)
        journal.write(job.path, outcome, job.concrete)

    return execute


def episode(setup: Setup, concrete: Mapping[str, Value]) -> Episode:
    """The episode of one concrete scenario, in a process with the limits of a test.

    Raises:
        InputError: if it fails or is over a limit.
    """
    with Pool(1, partial(_episode_maker, setup), setup.limits) as pool:
        _, result = next(pool.run([concrete]))
    if isinstance(result, Broken):
        raise InputError(f"the scenario cannot be executed: {result.reason}")
    return result


def _episode_maker(setup: Setup, calls: Calls) -> Callable[[Mapping[str, Value]], Episode]:
    tests = guarded(setup, calls)

    def execute(concrete: Mapping[str, Value]) -> Episode:
        try:
            return tests.run(concrete)
        except SimulationError as error:
            raise InputError(f"the scenario cannot be executed: {error}") from error

    return execute
