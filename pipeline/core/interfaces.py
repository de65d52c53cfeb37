"""What the closed loop connects: a `World` that shows and moves, and a `Detector` that looks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pipeline.core.detections import Detections
from pipeline.core.encounter import Encounter, RoadUsers
from pipeline.core.episode import Frame
from pipeline.core.ground import Pinhole
from pipeline.core.truth import Truth
from pipeline.core.variable import Value


@runtime_checkable
class Detector(Protocol):
    """A system under test: finds pedestrians in one camera frame.

    >>> import numpy as np
    >>> class Blind:
    ...     def detect(self, frame: Frame) -> Detections:
    ...         return Detections.none()
    >>> isinstance(Blind(), Detector)
    True
    """

    def detect(self, frame: Frame) -> Detections:
        """Find the pedestrians in `frame.image`.

        Args:
            frame: `image` is (height, width, 3) uint8 RGB. A detector reads the image alone.

        Returns:
            Pedestrians with scores at or above the detector's own threshold, best first.
        """
        ...


@dataclass(frozen=True)
class Observation:
    """A camera image with its ground truth, and the road users at that moment.

    Attributes:
        image: (height, width, 3) uint8 RGB.
        truth: boxes and visibility of the pedestrian in the image.
        users: positions at the time of exposure.
    """

    image: NDArray[np.uint8]
    truth: Truth
    users: RoadUsers


@runtime_checkable
class World(Protocol):
    """A simulator: it renders images and moves road users, and judges nothing.

    `pipeline.core.loop.run_test` drives it. A test depends only on the concrete scenario, the seed
    and the demands: repeating it gives the same bits, in any order and any process.
    `pipeline.testing.check_world` checks that.

    A study makes a world as `World(scenario=..., vehicle=..., **settings)`: the functional scenario
    (`pipeline.scenarios.functional.FunctionalScenario`), the brakes
    (`pipeline.core.braking.Vehicle`) and the other keys of its section in the config.

    A class may declare `needs`, a mapping from the variables that a scenario must have to the
    values that the world takes (`Admitted`), and `closed = True` if it ignores all others. A study
    that does not fit ends with an error before any test.

    Attributes:
        camera: maps boxes to the road.
        frame_s: time between two images, seconds; a multiple of `step_s`.
        step_s: time between two moments at which a contact is looked for, seconds.
    """

    camera: Pinhole
    frame_s: float
    step_s: float

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        """Begin a test.

        Args:
            concrete: the value of each variable of the scenario.
            seed: of everything random, such as the camera's noise, in [0, 2⁶⁴).

        Returns:
            The ego's path and the conflict point.

        Raises:
            SimulationError: if the scenario cannot be executed.
        """
        ...

    def observe(self) -> Observation:
        """Return the camera image, its truth and the road users, without moving anything."""
        ...

    def advance(self, seconds: float, acceleration_mps2: float) -> RoadUsers:
        """Move everything.

        Args:
            seconds: `step_s`.
            acceleration_mps2: what the car demands of its drive and brakes, as on a dry road:
                negative brakes, 0 keeps the speed, positive drives. On a wet road the same brake
                gives less.

        Returns:
            The road users after that time.

        Raises:
            SimulationError: if the simulation fails.
        """
        ...
