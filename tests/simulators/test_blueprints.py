"""What the space says of the pedestrians is what is drawn."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.config.composing import compose
from pipeline.simulators.mujoco.blueprints import BLUEPRINTS


def test_the_attributes_of_the_blueprints_are_those_that_are_drawn() -> None:
    variable = compose("default", []).space("F1").variables[-1]
    drawn = [BLUEPRINTS[name] for name in variable.values]
    known = dict(variable.attributes)
    for name in ("umbrella", "bag", "hat", "skirt"):
        assert list(known[name]) == [getattr(blueprint, name) for blueprint in drawn]
    assert list(known["height_m"]) == [blueprint.height for blueprint in drawn]
    for part in ("top", "trousers"):
        assert known[f"{part}_brightness"] == pytest.approx([np.mean(getattr(blueprint, part)) for blueprint in drawn], abs=5e-4)
