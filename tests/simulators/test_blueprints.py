"""The space's attributes of pedestrians match the drawn ones."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.config.composing import compose
from pipeline.simulators.mujoco.blueprints import BLUEPRINTS


def test_blueprint_attributes_match_the_drawn_pedestrians() -> None:
    variable = compose("default", []).space("F1").variables[-1]
    drawn = [BLUEPRINTS[name] for name in variable.values]
    known = dict(variable.attributes)
    for name in ("umbrella", "bag", "hat", "skirt"):
        assert list(known[name]) == [getattr(blueprint, name) for blueprint in drawn]
    assert list(known["height_m"]) == [blueprint.height for blueprint in drawn]
    for part in ("top", "trousers"):
        assert known[f"{part}_brightness"] == pytest.approx([np.mean(getattr(blueprint, part)) for blueprint in drawn], abs=5e-4)
