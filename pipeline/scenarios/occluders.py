"""Which road users stand between the ego and the pedestrian."""

from __future__ import annotations

import numpy as np

from pipeline.core.signals import SIDES, Signals
from pipeline.scenarios.functional import FunctionalScenario

HIDDEN = 0.1
"""Share of the pedestrian's box from which something counts as hiding it."""


def occluders(scenario: FunctionalScenario, signals: Signals) -> frozenset[str]:
    """The actors that stand between the ego and the pedestrian while something hides them.

    An actor counts if its footprint crosses the line of sight in a frame in which a tenth of the
    pedestrian's box or more is hidden. Trees, houses and other parts of the town do not count.
    """
    areas = []
    for box in ("visible", "whole"):
        left, top, right, bottom = (np.asarray(signals[f"{box}_{side}"], float) for side in SIDES)
        areas.append(np.nan_to_num((right - left) * (bottom - top)))
    visible, whole = areas
    hidden = np.flatnonzero((whole > 0) & (visible <= (1 - HIDDEN) * whole)).tolist()
    between = set()
    for name, actor in scenario.actors.items():
        route = actor.route()
        for step in hidden:
            pose = route.at(actor.travelled(float(signals["time_s"][step])))
            ego, pedestrian = (
                (float(signals[f"{who}_x_m"][step]), float(signals[f"{who}_y_m"][step]))
                for who in ("ego", "pedestrian")
            )
            if actor.footprint(pose).crossed_by(ego, pedestrian):
                between.add(name)
                break
    return frozenset(between)
