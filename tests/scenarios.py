"""Functional scenarios that several tests share."""

from __future__ import annotations

from pipeline.core.space import Space
from pipeline.scenarios.functional import Crossing, Ego, FunctionalScenario
from pipeline.scenarios.streets import Town


def scenario_with(space: Space) -> FunctionalScenario:
    """A straight street with a pedestrian who crosses it, and this space."""
    ego, crossing = Ego(speed_kmh=36, horizon_s=3), Crossing(heading_deg=90)
    return FunctionalScenario(label="T", description="A street.", town=Town(seed=1), ego=ego, pedestrian=crossing, space=space.to_dict())
