"""Command `top-view`: an unbraked run from above, for several speeds of the pedestrian."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.config.composing import functional_scenario
from pipeline.config.project import typed
from pipeline.core.footprints import Rectangle
from pipeline.core.paths import Pose
from pipeline.errors import InputError
from pipeline.scenarios.functional import EGO_HALF_LENGTH_M, EGO_HALF_WIDTH_M, FunctionalScenario
from pipeline.scenarios.streets import (
    CORNER_RADIUS,
    CROSSWALK_M,
    LANE_WIDTH,
    PAVEMENT_WIDTH,
    RAIL_M,
    Street,
    Town,
    streets,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HELP = "Draw an unbraked run from above, for several speeds of the pedestrian."
SPEEDS_MPS = (0.0, 1.5, 3.0)
FASTEST_MPS = 20
"""Beyond any runner's; a faster pedestrian would leave the street out of the picture."""
EVERY_S = 0.5
MARGIN_M = 6.0
"""Of the picture beyond everything that moves in it."""
GROUND, PAVEMENT, ASPHALT, MARKING = "#e9ece6", "#cfd3d8", "#a9afb7", "#f4f5f6"
EGO, PEDESTRIAN, VEHICLE, TREE = "#3b7dd8", "#c9372c", "#6b7480", "#7fa970"

Points = NDArray[np.float64]


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("scenario", help="name of a file in conf/scenario, such as F1")
    parser.add_argument(
        "--speeds",
        type=float,
        nargs="+",
        default=SPEEDS_MPS,
        help="of the pedestrian, m/s (default: 0 1.5 3)",
    )
    parser.add_argument(
        "--out",
        type=typed,
        default="top-view.png",
        help="the picture, a .png (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Write the picture."""
    from pipeline.report.style import save_png

    if options.out.suffix != ".png":
        raise InputError(f"--out: a view from above must be a .png, got {options.out.name}")
    for speed in options.speeds:
        if not 0 <= speed <= FASTEST_MPS:
            raise InputError(
                f"--speeds: expected speeds from 0 to {FASTEST_MPS} m/s, got {speed:g}"
            )
    save_png(top_view(functional_scenario(options.scenario), options.speeds), options.out)
    print(options.out)
    return 0


def top_view(scenario: FunctionalScenario, speeds_mps: Sequence[float]) -> Figure:
    """One panel for each speed of the pedestrian.

    It shows the street, the unbraked ego each half second, and the unshifted pedestrian at the
    same moments.

    Args:
        scenario: the scenario.
        speeds_mps: n speeds of the pedestrian.
    """
    from pipeline.report.style import PAGE_INCHES, panels, styled

    # Lowest and highest corner of the picture: both from start to horizon, with a margin.
    times = moments(scenario.ego.horizon_s)
    poses = [ego_pose(scenario, time) for time in times]
    if scenario.has_pedestrian:
        poses += [scenario.pedestrian_pose(time, speed) for time in times for speed in speeds_mps]
    places = np.array([(pose.x, pose.y) for pose in poses])
    low, high = places.min(axis=0) - MARGIN_M, places.max(axis=0) + MARGIN_M
    width, height = high - low
    columns = 1 if width > 1.3 * height else len(speeds_mps)
    inches = PAGE_INCHES / columns
    high_inches = inches * height / width + 0.5 + 0.3 * (columns > 1)
    with styled({"axes.grid": False}):
        figure, rows = panels(len(speeds_mps) // columns, columns, width=inches, height=high_inches)
        for axes, speed in zip(chain.from_iterable(rows), speeds_mps, strict=True):
            _street_map(axes, scenario.town)
            _road_users(axes, scenario, speed)
            axes.set(
                xlim=(low[0], high[0]),
                ylim=(low[1], high[1]),
                aspect="equal",
                xticks=[],
                yticks=[],
                facecolor=GROUND,
            )
            axes.spines[:].set_visible(False)
            axes.set_title(f"{scenario.label}, pedestrian {speed:g} m/s")
        figure.supxlabel(
            "Numbers: seconds after the start. Blue: ego, unbraked. Red: pedestrian. "
            "Cross: conflict point.",
            fontsize=9.5,
        )
    return figure


def moments(horizon_s: float) -> list[float]:
    """Each half second from the start, and the horizon, at which ego and pedestrian meet."""
    return [*np.arange(0, horizon_s - 1e-9, EVERY_S).tolist(), horizon_s]


def ego_pose(scenario: FunctionalScenario, time_s: float) -> Pose:
    """Pose of the unbraked ego's middle."""
    return scenario.ego.route().at(scenario.start_s() + scenario.ego.speed_kmh / 3.6 * time_s)


def _street_map(axes: Axes, town: Town) -> None:
    """Pavements, asphalt, markings and single trees."""
    by_name = {street.name: street for street in streets(town)}
    for colour, beyond in ((PAVEMENT, PAVEMENT_WIDTH), (ASPHALT, 0.0)):
        for street in by_name.values():
            axes.fill(*_outline(street, beyond).T, color=colour, linewidth=0)
    for street in by_name.values():
        lines = {street.middle, 0.0} if street.name == "main" else {street.middle}
        for v in lines:
            along = np.arange(street.start, street.end, 1.0)
            points = np.array([street.world(u, v) for u in along])
            axes.plot(*points.T, color=MARKING, linewidth=1, dashes=(6, 6))
    half = CROSSWALK_M / 2
    for crosswalk in town.crosswalks:
        street = by_name[crosswalk.street]
        for v in street.stripes():
            corners = [(-half, v), (half, v), (half, v + 0.5), (-half, v + 0.5)]
            stripe = np.array([street.world(crosswalk.at_m + u, side) for u, side in corners])
            axes.fill(*stripe.T, color=MARKING, linewidth=0)
    if town.rails_x_m is not None:
        for x in (town.rails_x_m - RAIL_M, town.rails_x_m + RAIL_M):
            axes.axvline(x, color=VEHICLE, linewidth=1.2)
    angles = np.linspace(0, 2 * np.pi, 24)
    for x, y in town.trees:
        crown = x + 1.2 * np.cos(angles), y + 1.2 * np.sin(angles)
        axes.fill(*crown, color=TREE, linewidth=0)


def _outline(street: Street, beyond: float) -> Points:
    """Corners of the asphalt and `beyond` metres on both sides, rounded at a junction."""
    if street.name == "side":
        angles, radius = np.linspace(np.pi, np.pi / 2, 12), CORNER_RADIUS - beyond
        u = CORNER_RADIUS + radius * np.cos(angles)
        v = LANE_WIDTH + CORNER_RADIUS - radius * np.sin(angles)
        corner = np.stack([u, v], axis=1)
        left = np.concatenate([corner, [(street.end, LANE_WIDTH + beyond)]])
        return np.array([street.world(u, v) for u, v in [*left, *(left * (1, -1))[::-1]]])
    bay = street.bay or (0.0, 0.0)
    edges = [bay[0] - 1e-3, *bay, bay[1] + 1e-3]
    u = np.sort(np.concatenate([np.arange(street.start, street.end, 2.0), edges]))
    right = [street.world(at, -street.edge(-1, at) - beyond) for at in u]
    return np.array([*right, *(street.world(at, street.left + beyond) for at in u[::-1])])


def _road_users(axes: Axes, scenario: FunctionalScenario, speed_mps: float) -> None:
    """The other vehicles at start and horizon; ego, pedestrian and conflict point over them."""
    times = moments(scenario.ego.horizon_s)
    for actor in scenario.actors.values():
        route = actor.route()
        first = actor.footprint(route.at(actor.travelled(times[0])))
        last = actor.footprint(route.at(actor.travelled(times[-1])))
        alpha = 0.9 if actor.speed_kmh == 0 else 0.35
        axes.fill(*last.corners.T, color=VEHICLE, alpha=alpha, linewidth=0)
        axes.fill(*first.corners.T, facecolor="none", edgecolor=VEHICLE, linewidth=1)
    _ego(axes, scenario, times)
    if scenario.has_pedestrian:
        _pedestrian(axes, scenario, speed_mps, times)
    if scenario.asks_to_brake:
        axes.plot(
            *scenario.pedestrian.at, marker="x", color="black", markersize=8, markeredgewidth=2
        )


def _ego(axes: Axes, scenario: FunctionalScenario, times: Sequence[float]) -> None:
    """The ego's path, and its footprint at each moment, numbered at its front."""
    poses = [ego_pose(scenario, time) for time in np.linspace(-2, times[-1], 200)]
    path = np.array([(pose.x, pose.y) for pose in poses])
    axes.plot(*path.T, color=EGO, linewidth=1.2)
    for time in times:
        pose = ego_pose(scenario, time)
        footprint = Rectangle(pose, EGO_HALF_LENGTH_M, EGO_HALF_WIDTH_M)
        axes.fill(*footprint.corners.T, facecolor=EGO, alpha=0.35, edgecolor=EGO)
        axes.annotate(
            f"{time:g}",
            (pose.x, pose.y),
            color="white",
            fontsize=8,
            fontweight="bold",
            ha="center",
            va="center",
        )


def _pedestrian(
    axes: Axes, scenario: FunctionalScenario, speed_mps: float, times: Sequence[float]
) -> None:
    """The pedestrian at each moment, with every second's number beside its path.

    A standing pedestrian has a single number.
    """
    poses = [scenario.pedestrian_pose(time, speed_mps) for time in times]
    axes.plot(
        [pose.x for pose in poses],
        [pose.y for pose in poses],
        "o-",
        color=PEDESTRIAN,
        markersize=5,
        linewidth=1,
    )
    heading = poses[0].heading
    ahead = np.array([np.cos(heading), np.sin(heading)])
    beside = 1.4 * np.array([ahead[1], -ahead[0]])
    texts = {}
    for time, pose in zip(times, poses, strict=True):
        if time == times[-1] or (time.is_integer() and time < times[-1] - EVERY_S):
            texts[f"{time:g}"] = pose
    if speed_mps == 0:
        texts, beside = {f"{times[0]:g} to {times[-1]:g}": poses[0]}, beside - 1.4 * ahead
    for text, pose in texts.items():
        axes.annotate(
            text,
            (pose.x + beside[0], pose.y + beside[1]),
            color=PEDESTRIAN,
            fontsize=8,
            ha="center",
            va="center",
        )
