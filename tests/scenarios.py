"""Functional scenarios that several tests share."""

from __future__ import annotations

from pipeline.core.space import Space
from pipeline.scenarios.functional import Crossing, Ego, FunctionalScenario
from pipeline.scenarios.streets import Town


def scenario_with(space: Space) -> FunctionalScenario:
    """A straight street with a pedestrian who crosses it, and this space.

    The variable `blueprint` of the space, if any, names population 1.
    """
    ego, crossing = Ego(speed_kmh=36, horizon_s=3), Crossing(heading_deg=90)
    plain, town = space.to_dict(), Town(seed=1)
    people = 1 if plain.pop("blueprint", None) else None
    return FunctionalScenario(
        label="T",
        description="A street.",
        town=town,
        ego=ego,
        pedestrian=crossing,
        people=people,
        space=plain,
    )
