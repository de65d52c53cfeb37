"""The planted regions of `pipeline.simulators.analytic` as a function of many points at once."""

from __future__ import annotations

import numpy as np

from pipeline.core.car import Car
from pipeline.core.kpi import evaluate
from pipeline.core.space import Floats, Ints, Space
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.scenarios.functional import FunctionalScenario
from pipeline.simulators.analytic import (
    MARGIN,
    PLANTED,
    SAFE_DETECTION_M,
    AnalyticSimulator,
    Planted,
)

LOST_M = 13.0
"""Detection distance that a test loses across the margin of a region."""


class AnalyticWorld:
    """Gives the KPI that the simulator gives, exactly.

    The outcome depends on the metre in which the ego first brakes, so one test of each is executed, and the others share its KPI.
    """

    def __init__(self, scenario: FunctionalScenario, car: Car, failure_threshold_s: float) -> None:
        self.space = scenario.logical_space()
        self._simulator, self._threshold_s = AnalyticSimulator(scenario, car), failure_threshold_s
        self._known: dict[int, float] = {}

    def kpi(self, points: Floats) -> Floats:
        """(n, d) points to (n,) seconds."""
        brakes_at = self._brakes_at(points)
        for metre in set(brakes_at.tolist()) - set(self._known):
            self._known[metre] = self.executed(points[np.argmax(brakes_at == metre)])
        return np.array([self._known[metre] for metre in brakes_at.tolist()])

    def executed(self, point: Floats) -> float:
        """The KPI of a (d,) point by the simulator, seconds."""
        episode = self._simulator.execute(self.space.decode(point), VisiblePixelOracle())
        return evaluate(episode.signals, self._threshold_s).adj_ttc_s

    def _brakes_at(self, points: Floats) -> Ints:
        """The metre to the conflict point at which the ego, one metre a time step, first brakes, (n,)."""
        depth = np.max([_depth(self.space, region, points) for region in PLANTED], axis=0)
        sees_at = np.where(depth >= 1, 0.0, SAFE_DETECTION_M - LOST_M * np.maximum(0.0, depth))
        return np.floor(sees_at).astype(np.int64)


def _depth(space: Space, region: Planted, points: Floats) -> Floats:
    """Depth of (n, d) points in a region, (n,), by the simulator's operations in their order: equal to the last bit."""
    depth = np.full(len(points), np.inf)
    for name, (low, high) in region.intervals.items():
        value = points[:, space.names.index(name)]
        outside = np.maximum(np.maximum(low - value, value - high), 0.0)
        depth = np.minimum(depth, 1 - outside / (MARGIN * (high - low) / 2))
    for name, values in region.values.items():
        column = space.names.index(name)
        admitted = [space.variables[column].values.index(value) for value in values]
        depth[~np.isin(points[:, column], admitted)] = -1.0
    return depth
