"""Foreign worlds and detectors, whose exceptions end one test, not the campaign."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.core.car import Car
from pipeline.core.detections import Detections
from pipeline.core.episode import Episode, Frame
from pipeline.core.loop import run_test
from pipeline.core.space import Value
from pipeline.errors import InputError, SimulationError, machine_error
from pipeline.execution.worker import Calls
from pipeline.protocols import Detector, World

LONGEST = 300
"""Characters of a foreign message that are kept."""


class GuardedDetector:
    """A detector whose exceptions become errors of one test, and that shows when it is at work.

    Args:
        detector: the foreign detector.
        calls: counter shared with the parent, incremented before and after each frame; odd means
            busy.
    """

    def __init__(self, detector: Detector, calls: Calls) -> None:
        self._detector, self._calls = detector, calls

    def detect(self, frame: Frame) -> Detections:
        """Return the detector's result.

        Raises:
            SimulationError: for any exception but InputError and the machine's, which end the
                campaign.
        """
        self._calls.value += 1
        name = f"{type(self._detector).__name__}.detect"
        try:
            detections = self._detector.detect(frame)
        except (InputError, SimulationError):
            raise
        except BaseException as error:  # SystemExit, too, is foreign code's.
            raise failed(name, error) from error
        finally:
            self._calls.value += 1
        if not isinstance(detections, Detections):
            raise SimulationError(f"{name} must return Detections, got {type(detections).__name__}")
        return detections


class GuardedTests:
    """Executes the tests of one world, detector and car. keep_every: see `run_test`."""

    def __init__(self, world: World, detector: Detector, car: Car, keep_every: int = 0) -> None:
        self._world, self._detector, self._car, self._keep_every = world, detector, car, keep_every

    def run(
        self, concrete: Mapping[str, Value], noise: Mapping[str, Value] | None = None
    ) -> Episode:
        """Return the episode of a concrete scenario; see `run_test`.

        Raises:
            SimulationError: for any exception but InputError and the machine's, which end the
                campaign.
        """
        try:
            return run_test(
                self._world,
                self._detector,
                self._car,
                concrete,
                keep_every=self._keep_every,
                noise=noise,
            )
        except (InputError, SimulationError):
            raise
        except BaseException as error:
            raise failed(type(self._world).__name__, error) from error


def failed(foreign: str, error: BaseException) -> Exception:
    """The error of a test for an exception in foreign code, or the machine's."""
    text = f"{foreign} failed: {type(error).__name__}: {error}"
    return machine_error(error) or SimulationError(text[:LONGEST])
