"""Tests simulated again for the report: the same test gives the same frames."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.config.components import make_world
from pipeline.config.schema import Config
from pipeline.core.episode import Episode
from pipeline.core.loop import run_test
from pipeline.errors import InputError, SimulationError, machine_error
from pipeline.progress import OnProgress
from pipeline.protocols import Detector, World
from pipeline.report.examples import Chosen


class Reruns:
    """Simulates tests again and keeps all their frames; one world a scenario, one detector a version.

    detector_of: makes a version's detector. total: number of tests to come, for `progress`.
    """

    def __init__(
        self,
        config: Config,
        detector_of: Callable[[str], Detector],
        total: int,
        progress: OnProgress,
    ) -> None:
        self._config, self._detector_of, self._total, self._progress = (
            config,
            detector_of,
            total,
            progress,
        )
        self._worlds: dict[str, World] = {}
        self._detectors: dict[str, Detector] = {}
        self._done = 0

    def execute(self, test: Chosen) -> Episode:
        """The episode of a test; InputError if it cannot be executed again."""
        config = self._config
        if test.scenario not in self._worlds:
            scenario = config.scenarios[test.scenario]
            self._worlds[test.scenario] = make_world(config.simulator, scenario, config.car.vehicle)
        if test.version not in self._detectors:
            self._detectors[test.version] = self._detector_of(test.version)
        try:
            episode = run_test(
                self._worlds[test.scenario],
                self._detectors[test.version],
                config.car,
                test.concrete,
                keep_every=1,
            )
        except SimulationError as error:
            raise InputError(
                f"{test.test_id}: expected the test to end as before, got an error: {error}"
            ) from error
        except InputError:
            raise
        except Exception as error:  # Foreign code may raise anything.
            told = machine_error(error)
            raise told or InputError(
                f"{test.test_id}: expected the test to end as before, got {type(error).__name__}: {error}"
            ) from error
        self._done += 1
        self._progress(self._done, self._total, test.heading)
        return episode
