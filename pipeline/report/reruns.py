"""Tests executed again for the report: the same test gives the same frames."""

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
    """Executes tests again and keeps all their frames.

    It makes one world a scenario and one detector a version.
    """

    def __init__(
        self,
        config: Config,
        detector_of: Callable[[str], Detector],
        total: int,
        progress: OnProgress,
    ) -> None:
        """Prepare to execute tests.

        Args:
            config: The study's configuration.
            detector_of: Makes the detector of a version.
            total: Number of tests to come, for `progress`.
            progress: Called after each test.
        """
        self._config, self._detector_of = config, detector_of
        self._total, self._progress = total, progress
        self._worlds: dict[str, World] = {}
        self._detectors: dict[str, Detector] = {}
        self._done = 0

    def execute(self, test: Chosen) -> Episode:
        """The episode of a test.

        Raises:
            InputError: The test cannot be executed again.
        """
        config = self._config
        if test.scenario not in self._worlds:
            scenario = config.scenarios[test.scenario]
            self._worlds[test.scenario] = make_world(config.simulator, scenario, config.car.vehicle)
        if test.version not in self._detectors:
            self._detectors[test.version] = self._detector_of(test.version)
        world, detector = self._worlds[test.scenario], self._detectors[test.version]
        expected = f"{test.test_id}: expected the test to end as before"
        try:
            episode = run_test(world, detector, config.car, test.concrete, keep_every=1)
        except SimulationError as error:
            raise InputError(f"{expected}, got an error: {error}") from error
        except InputError:
            raise
        except Exception as error:  # Foreign code may raise anything.
            foreign = InputError(f"{expected}, got {type(error).__name__}: {error}")
            raise machine_error(error) or foreign from error
        self._done += 1
        self._progress(self._done, self._total, test.heading)
        return episode
