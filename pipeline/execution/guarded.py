"""Foreign simulators and detectors, whose exceptions end one test, not the campaign."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.core.detections import Detections
from pipeline.core.episode import Episode, Frame
from pipeline.core.space import Value
from pipeline.errors import InputError, SimulationError, machine_error
from pipeline.execution.worker import Calls
from pipeline.protocols import Detector, Simulator


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
        try:
            detections = self._detector.detect(frame)
        except (InputError, SimulationError):
            raise
        except BaseException as error:  # SystemExit, too, is foreign code's.
            raise failed(self._detector, "detect", error) from error
        finally:
            self._calls.value += 1
        if not isinstance(detections, Detections):
            raise SimulationError(
                f"{type(self._detector).__name__}.detect must return Detections, "
                f"got {type(detections).__name__}"
            )
        return detections


class GuardedSimulator:
    """A simulator that turns exceptions of foreign code into errors."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator

    def execute(
        self,
        concrete: Mapping[str, Value],
        detector: Detector,
        keep_every: int = 0,
        noise: Mapping[str, Value] | None = None,
    ) -> Episode:
        """Return the episode.

        Raises:
            SimulationError: for any exception but InputError and the machine's, which end the
                campaign.
        """
        try:
            return self._simulator.execute(
                concrete, detector, keep_every, **({} if noise is None else {"noise": noise})
            )
        except (InputError, SimulationError):
            raise
        except BaseException as error:
            raise failed(self._simulator, "execute", error) from error


LONGEST = 300
"""Characters of a foreign message that are kept."""


def failed(foreign: object, call: str, error: BaseException) -> Exception:
    """The error of a test for an exception in foreign code, or the machine's."""
    text = f"{type(foreign).__name__}.{call} failed: {type(error).__name__}: {error}"
    return machine_error(error) or SimulationError(text[:LONGEST])
