"""How the ego brakes, and whether any detector could have stopped it in time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.core.visibility import visible

FULL_BRAKE_MPS2 = 8.0
BRAKE_LAG_S = 0.1
"""Of the first-order lag between demand and deceleration."""


def stopping_distance(speed_mps: ArrayLike) -> NDArray[np.float64]:
    """Metres until the ego stops under full braking from a speed in m/s, brake lag included."""
    speed = np.asarray(speed_mps, dtype=float)
    return np.asarray(speed * BRAKE_LAG_S + speed**2 / (2 * FULL_BRAKE_MPS2))


def solvable(signals: Mapping[str, NDArray[Any]]) -> bool:
    """Whether full braking from some time step at which a person could see the pedestrian would have stopped the ego in time.

    signals: columns of a test execution, (t,) each. A person sees what is `visible`. If the answer is no, no detector that judges single
    images as well as a person could pass the test with this camera: sensor and sight line are the limit. The pedestrian's own motion out of
    the way does not count.
    """
    seen = visible(signals["visible_pixels"], signals["contrast"])
    in_time = np.asarray(signals["conflict_distance_m"]) > stopping_distance(signals["ego_speed_mps"])
    return bool((seen & in_time).any())
