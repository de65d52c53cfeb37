"""Which road users stand between the ego and the pedestrian."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.core.signals import SIDES, Signals
from pipeline.scenarios.functional import FunctionalScenario

HIDDEN = 0.1
"""Share of the pedestrian's box from which something counts as hiding it."""


def occluders(scenario: FunctionalScenario, signals: Signals) -> frozenset[str]:
    """The actors whose footprint crosses the line of sight in a frame in which something hides a tenth of the pedestrian's box or more.

    Trees, houses and other parts of the town are not among them.
    """
    visible, whole = (_areas(signals, box) for box in ("visible", "whole"))
    steps = np.flatnonzero((whole > 0) & (visible <= (1 - HIDDEN) * whole))
    return frozenset(
        name
        for name in scenario.actors
        if any(_between(scenario, name, signals, step) for step in steps.tolist())
    )


def _between(scenario: FunctionalScenario, name: str, signals: Signals, step: int) -> bool:
    actor = scenario.actors[name]
    footprint = actor.footprint(actor.route().at(actor.travelled(float(signals["time_s"][step]))))
    ego, pedestrian = (
        (float(signals[f"{who}_x_m"][step]), float(signals[f"{who}_y_m"][step]))
        for who in ("ego", "pedestrian")
    )
    return footprint.crossed_by(ego, pedestrian)


def _areas(signals: Signals, box: str) -> NDArray[np.float64]:
    """Area of a box in each frame, (t,) pixels; 0 without a box."""
    left, top, right, bottom = (np.asarray(signals[f"{box}_{side}"], float) for side in SIDES)
    return np.asarray(np.nan_to_num((right - left) * (bottom - top)))
