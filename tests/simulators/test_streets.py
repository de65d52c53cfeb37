"""The layout of streets, and the towns and scenarios that are refused."""

from __future__ import annotations

from typing import Any, Literal
from unittest.mock import Mock

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.config.composing import CONF, functional_scenario
from pipeline.core.paths import Path
from pipeline.scenarios.streets import CORNER_RADIUS, Junction, Town, on_asphalt, streets
from pipeline.simulators.mujoco import buildings

NAMES = sorted(path.stem for path in (CONF / "scenario").glob("[FN]*.yaml"))


def test_all_scenarios_exist() -> None:
    assert (
        sorted(
            [f"F{i}" for i in range(1, 9)]
            + [f"F{i}star" for i in range(1, 7)]
            + [f"N{i}" for i in range(1, 5)]
        )
        == NAMES
    )


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith("F")])
def test_scenarios_match_their_tables(name: str) -> None:
    scenario = functional_scenario(name)
    held_out, text = name.endswith("star"), scenario.description.lower()
    assert (scenario.town.style == "suburban") == held_out
    assert ("junction" in text) == (scenario.town.junction is not None)
    assert ("crosswalk" in text) == bool(scenario.town.crosswalks)
    assert ("bus station" in text) == (scenario.town.bus_bay is not None)
    assert ("train line" in text) == (scenario.town.rails_x_m is not None)
    at = scenario.ego.route().at(scenario.conflict_s())
    across = np.sin(np.radians(scenario.pedestrian.heading_deg) - at.heading)
    # From the nearside (right) to the left; from the farside to the right; else along the road.
    assert round(float(across)) == ("nearside" in text) - ("farside" in text)
    turned = 90 * (("turns left" in text) - ("turns right" in text))
    assert np.degrees(at.heading) == pytest.approx(turned)
    ahead = [actor for actor in scenario.actors.values() if actor.kind != "bus"]
    assert ahead and len(scenario.logical_space()) == 8


def test_the_street_frames_agree_with_the_world() -> None:
    sides: tuple[tuple[Literal["left", "right"], int], ...] = (("left", 1), ("right", -1))
    for side, sign in sides:
        town = Town(seed=0, junction=Junction(x_m=10, side=side))
        main, street = streets(town)
        assert street.world(*street.local(3.3, 4.4)) == pytest.approx((3.3, 4.4))
        # The lane away from the junction is the right one.
        assert street.world(20, -1.75) == pytest.approx((10 + sign * 1.75, sign * 23.5))
        assert main.open(sign, 10) and not main.open(-sign, 10)


def test_asphalt_ends_at_kerbs_and_rounded_corners() -> None:
    town = Town(seed=0, lanes_ahead=2, bus_bay=(-30, -10), junction=Junction(x_m=10, side="left"))
    for x, y, inside in (
        (0, -3.4, True),
        (0, -3.6, False),
        (-20, -6.5, True),
        (0, 6.9, True),
        (0, 7.1, False),
        (10, 30, True),
        (13.6, 30, False),
    ):
        assert on_asphalt(town, x, y) is inside, (x, y)
    corner = np.array([10 + 3.5 + CORNER_RADIUS, 7 + CORNER_RADIUS])
    for angle in np.radians([200, 225, 250]):
        x, y = corner + (CORNER_RADIUS + 0.1) * np.array([np.cos(angle), np.sin(angle)])
        assert on_asphalt(town, float(x), float(y))
        x, y = corner + (CORNER_RADIUS - 0.1) * np.array([np.cos(angle), np.sin(angle)])
        assert not on_asphalt(town, float(x), float(y))
    turn = Path([(-40, -1.75), (8.25, -1.75), (8.25, -40)], radius=7.75)
    town = Town(seed=0, junction=Junction(x_m=10, side="right"))
    poses = [turn.at(s) for s in np.arange(0, turn.length, 0.5)]
    assert all(on_asphalt(town, pose.x, pose.y, margin=1.7) for pose in poses)


@pytest.mark.parametrize("curvature", [1 / 60, -1 / 60])
def test_a_curved_street_keeps_its_lanes(curvature: float) -> None:
    town = Town(seed=0, lanes_ahead=2, curvature_1pm=curvature, bus_bay=(20, 40))
    main = streets(town)[0]
    centre = np.array([0, 1 / curvature])
    for u in (-60.0, 0.0, 30.0, 90.0):
        for v, inside in (
            (-3.4, True),
            (6.9, True),
            (7.1, False),
            (-6.5, 20 < u < 40),
            (-6.7, False),
        ):
            pose = main.pose(u, v)
            assert main.local(pose.x, pose.y) == pytest.approx((u, v))
            assert np.hypot(*(centre - (pose.x, pose.y))) == pytest.approx(abs(1 / curvature - v))
            assert on_asphalt(town, pose.x, pose.y) is inside, (u, v)


@pytest.mark.parametrize("x_m", [-20, -14, 14, 20])
def test_no_house_stands_on_the_rails_beside_a_junction(
    x_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    town, houses = Town(seed=3, junction=Junction(x_m=0, side="left"), rails_x_m=x_m), []
    monkeypatch.setattr(buildings, "_build", lambda _, house: houses.append(house.us))
    for seed in range(20):
        buildings.add(Mock(), town, streets(town)[0], 1, np.random.default_rng(seed))
    for middle in (0, x_m):
        assert all(end < middle - 1.5 or begin > middle + 1.5 for begin, end in houses)


@pytest.mark.parametrize(
    ("town", "message"),
    [
        (
            {"curvature_1pm": 0.01, "rails_x_m": 9},
            "a street with a junction or a train line must be straight",
        ),
        ({"curvature_1pm": 0.1}, "less than or equal to 0.02"),
        ({"bus_bay": (5, -5)}, "bus_bay must run from a smaller to a larger x"),
        ({"bus_bay": (0, 20), "junction": {"x_m": 10, "side": "right"}}, "overlaps the junction"),
        ({"crosswalks": ({"street": "side", "at_m": 9},)}, "the town has no junction"),
        (
            {"crosswalks": ({"at_m": 151},)},
            r"crosswalks: at_m must be in \[-75, 150\] on the main street, got 151",
        ),
        (
            {
                "crosswalks": ({"street": "side", "at_m": -1},),
                "junction": {"x_m": 10, "side": "right"},
            },
            r"crosswalks: at_m must be in \[0, 85\] on the side street, got -1",
        ),
        ({"trees": ((0, 1),)}, "stands on the road"),
        ({"junction": {"x_m": 10, "side": "north"}}, "'left' or 'right'"),
        ({"lanes_ahead": 3}, "less than or equal to 2"),
    ],
)
def test_impossible_towns_are_refused(town: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Town.model_validate({"seed": 0, **town})
