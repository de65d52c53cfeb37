"""How the ego drives: its dynamics, cruise control and automatic emergency brake (AEB)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.core.detections import Detections

GRAVITY_MPS2 = 9.81
WET_FROM_RAIN = 60.0
"""Rain, in %, from which the road is fully wet."""
EMERGENCY_MPS2 = 5.0
"""Demanded deceleration from which braking is emergency braking: the least that UN Regulation
No. 152, 5.2.1.2, asks for."""
GateKind = Literal["truth", "detections"]
LawKind = Literal["confidence", "threshold"]
CruiseKind = Literal["keep", "hold"]
CRUISE_S = 1.0
"""Time in which the cruise control would make up for a difference in speed, without its limits."""


@dataclass(frozen=True)
class Vehicle:
    """The ego's brakes and cruise control.

    Attributes:
        dry_friction: peak friction of tyre and dry road, in (0, 1.5].
        wet_friction: the same on a wet road.
        build_up_s: time constant of the first-order lag between demand and deceleration, in [0, 2];
            90 % is reached after 2.3 time constants.
        latency_s: from the exposure of a frame to the demand that it causes, in [0, 2].
        cruise: what the ego does while nothing asks it to brake: `keep` its present speed, also
            after braking, or `hold` the speed that it was set to, so that it accelerates again.
        acceleration_mps2: highest acceleration of `hold`, in (0, 5].
        jerk_mps3: highest rise of that acceleration, in (0, 10].
    """

    dry_friction: float
    wet_friction: float
    build_up_s: float
    latency_s: float
    cruise: CruiseKind = "keep"
    acceleration_mps2: float = 2.0
    jerk_mps3: float = 2.5

    def __post_init__(self) -> None:
        for name in ("dry_friction", "wet_friction"):
            if not 0 < getattr(self, name) <= 1.5:
                raise ValueError(f"{name} must be in (0, 1.5], got {getattr(self, name)}")
        for name in ("build_up_s", "latency_s"):
            if not 0 <= getattr(self, name) <= 2:
                raise ValueError(f"{name} must be in [0, 2] s, got {getattr(self, name)}")
        for name, most in (("acceleration_mps2", 5), ("jerk_mps3", 10)):
            if not 0 < getattr(self, name) <= most:
                raise ValueError(f"{name} must be in (0, {most}], got {getattr(self, name)}")

    def full_brake_mps2(self, rain: float) -> float:
        """Deceleration under full demand: friction falls linearly until the road is fully wet.

        >>> Vehicle(0.8, 0.6, build_up_s=0.1, latency_s=0.1).full_brake_mps2(rain=60)
        5.886
        """
        wetness = min(1.0, rain / WET_FROM_RAIN)
        friction = self.dry_friction + wetness * (self.wet_friction - self.dry_friction)
        return GRAVITY_MPS2 * friction

    def stopping_distance(self, speed_mps: ArrayLike, rain: float) -> NDArray[np.float64]:
        """Metres from the exposure of a frame until the ego stops under full braking.

        Latency and build-up are included. The result has the shape of `speed_mps`.
        """
        speed = np.asarray(speed_mps, dtype=float)
        delayed_m = speed * (self.latency_s + self.build_up_s)
        return np.asarray(delayed_m + speed**2 / (2 * self.full_brake_mps2(rain)))


class CruiseControl:
    """The cruise control during one test.

    Args:
        vehicle: its kind and limits.
        set_mps: the speed that it was set to.

    >>> car = Vehicle(0.8, 0.6, build_up_s=0, latency_s=0, cruise="hold")
    >>> cruise = CruiseControl(car, set_mps=10)
    >>> [round(cruise.demand(speed_mps=5, brake_mps2=0, seconds=0.4), 3) for _ in range(3)]
    [1.0, 2.0, 2.0]
    >>> cruise.demand(speed_mps=5, brake_mps2=3, seconds=0.4)
    -3
    """

    def __init__(self, vehicle: Vehicle, set_mps: float) -> None:
        self._vehicle, self._set_mps = vehicle, set_mps
        self._acceleration = 0.0

    def demand(self, speed_mps: float, brake_mps2: float, seconds: float) -> float:
        """The acceleration that the car demands next, m/s².

        Args:
            speed_mps: of the ego.
            brake_mps2: the deceleration that the emergency brake demands, at least 0. It overrules
                the cruise control, which begins from no acceleration afterwards.
            seconds: time for which the demand holds.
        """
        vehicle = self._vehicle
        if brake_mps2 > 0 or vehicle.cruise == "keep":
            self._acceleration = 0.0
            return -brake_mps2
        wanted = min((self._set_mps - speed_mps) / CRUISE_S, vehicle.acceleration_mps2)
        rising = self._acceleration + vehicle.jerk_mps3 * seconds
        self._acceleration = max(0.0, min(wanted, rising))
        return self._acceleration


@dataclass(frozen=True)
class Aeb:
    """The law of the emergency brake.

    It brakes if the newest frame asks for it, and at least `votes` of the last `window` frames do.

    Attributes:
        gate: the detections that it follows: those that match the true pedestrian (`truth`, thesis
            section 5.3) or those in the ego's path (`detections`).
        law: the demand is the best score (`confidence`, thesis section 5.3), or 1 (`threshold`).
        brakes_from: lowest score that brakes, in [0, 1].
        votes: in [1, window].
        window: number of frames.
        margin_m: metres beside the ego that still belong to its path, in [0, 5].
    """

    gate: GateKind
    law: LawKind
    brakes_from: float
    votes: int
    window: int
    margin_m: float

    def __post_init__(self) -> None:
        if not 0 <= self.brakes_from <= 1:
            raise ValueError(f"brakes_from must be in [0, 1], got {self.brakes_from}")
        if not 1 <= self.votes <= self.window:
            raise ValueError(
                f"votes must be at least 1 and at most window, got {self.votes} of {self.window}"
            )
        if not 0 <= self.margin_m <= 5:
            raise ValueError(f"margin_m must be in [0, 5] m, got {self.margin_m}")

    def demand(self, best: ArrayLike, asking: ArrayLike) -> NDArray[np.float64]:
        """Brake demand in [0, 1].

        Args:
            best: the newest frame's best score that asks for it, 0 for none.
            asking: number of the last `window` frames that ask, of the same shape.
        """
        score = np.asarray(best, dtype=float)
        brakes = (score > 0) & (np.asarray(asking) >= self.votes)
        return np.where(brakes, 1.0 if self.law == "threshold" else score, 0.0)


class EmergencyBrake:
    """The emergency brake during one test: remembers the frames that its law needs."""

    def __init__(self, aeb: Aeb) -> None:
        self._aeb = aeb
        self._asked: deque[bool] = deque(maxlen=aeb.window)

    def demand(self, detections: Detections, followed: NDArray[np.bool_]) -> float:
        """Brake demand in [0, 1] after a frame.

        Args:
            detections: of the frame.
            followed: (n,) whether the gate lets each detection through.
        """
        aeb = self._aeb
        asking = followed & (detections.scores >= aeb.brakes_from)
        best = float(detections.scores[asking].max(initial=0.0))
        self._asked.append(best > 0)
        return float(aeb.demand(best, sum(self._asked)))
