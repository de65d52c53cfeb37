"""A concrete scenario as ASAM OpenDRIVE 1.6 and OpenSCENARIO XML 1.1, to replay a finding in CARLA
or esmini.

Exported: streets, junction, crosswalks, every road user's start and unbraked motion, sun, fog and
rain. Not exported: houses, trees, the crosswalk that our camera shows on a main street without
crosswalks, junction and rails, the pedestrian's looks and animation, and the braking, which depends
on the detector.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np

from pipeline.artefacts.files import write_bytes
from pipeline.core import paths
from pipeline.core.space import Value
from pipeline.core.visibility import visual_range_m
from pipeline.errors import InputError
from pipeline.scenarios.functional import (
    EGO_HALF_LENGTH_M,
    EGO_HALF_WIDTH_M,
    HALF_LENGTHS_M,
    HALF_WIDTHS_M,
    FunctionalScenario,
)
from pipeline.scenarios.streets import (
    CROSSWALK_M,
    LANE_WIDTH,
    PAVEMENT_WIDTH,
    Street,
    Town,
    streets,
)

DATE = "2026-01-01T00:00:00"
"""Fixed, so the same scenario gives the same files."""
JUNCTION_ID = "100"
WEATHER = ("rain", "fog", "sun_altitude", "sun_azimuth")
"""The variables that a story needs."""
WALK = ("pedestrian_speed", "pedestrian_shift")
"""The variables that a pedestrian needs."""
SUN_LUX = 100_000
"""Of the sun at the zenith."""


def write_openscenario(
    scenario: FunctionalScenario, concrete: Mapping[str, Value], out: Path
) -> tuple[Path, Path]:
    """Write `<out>.xodr` and `<out>.xosc`; returns both paths.

    InputError if the scenario lacks a variable that they need.
    """
    stem = out.with_suffix("") if out.suffix in (".xodr", ".xosc") else out
    if not stem.name:
        raise InputError(f"{out}: expected a name for both files")
    road, story = (stem.with_name(stem.name + suffix) for suffix in (".xodr", ".xosc"))
    roots = {road: open_drive(scenario.town), story: open_scenario(scenario, concrete, road.name)}
    for path, root in roots.items():
        write_bytes(path, xml_bytes(root))
    return road, story


def xml_bytes(root: Xml.Element) -> bytes:
    """Write the element tree as an indented XML file."""
    Xml.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root) + b"\n"


def _add(parent: Xml.Element, tag: str, **attributes: object) -> Xml.Element:
    """A child element; trailing underscores of attribute names are dropped, numbers are written in
    full.
    """
    texts = {
        name.rstrip("_"): f"{value:.6f}" if isinstance(value, float) else str(value)
        for name, value in attributes.items()
    }
    return Xml.SubElement(parent, tag, texts)


def open_drive(town: Town) -> Xml.Element:
    """The road network: main street 1 (and 2 behind a junction), side street 3, connecting roads 11
    to 13.

    InputError for a crosswalk inside the junction, which lies on none of its roads.
    """
    root = Xml.Element("OpenDRIVE")
    _add(
        root,
        "header",
        revMajor=1,
        revMinor=6,
        name="blindspot",
        version="1.00",
        date=DATE,
        north=200.0,
        south=-200.0,
        east=200.0,
        west=-200.0,
    )
    main, *side = streets(town)
    ahead = town.lanes_ahead
    if not side:
        road = _road(root, "1", _reference_line(main, main.start, main.end), ahead, main)
        _check_crosswalks(town, _objects(road, town, main, 0.0))
        return root
    street = side[0]
    mouth = next((gap.start, gap.end) for gap in main.gaps if gap.mouth)
    reach = street.world(8, 0)
    ends = {"1": (mouth[0], main.middle), "2": (mouth[1], main.middle), "3": reach}
    west = _road(
        root, "1", _reference_line(main, main.start, mouth[0]), ahead, main, successor=JUNCTION_ID
    )
    east = _road(
        root, "2", _reference_line(main, mouth[1], main.end), ahead, main, predecessor=JUNCTION_ID
    )
    away = _road(
        root, "3", _reference_line(street, 8, street.end), 1, street, predecessor=JUNCTION_ID
    )
    placed = sum(
        _objects(road, town, main, first - main.start)
        for road, first in ((west, main.start), (east, mouth[1]))
    )
    _check_crosswalks(town, placed + _objects(away, town, street, 8.0))
    junction = Xml.Element("junction", id=JUNCTION_ID, name="T")
    corner = (street.origin[0], main.middle)
    links = {
        "11": ("1", "2", (ends["1"], ends["2"])),
        "12": ("1", "3", (ends["1"], corner, reach)),
        "13": ("3", "2", (reach, corner, ends["2"])),
    }
    for number, (incoming, outgoing, through) in links.items():
        lanes = ahead if number == "11" else 1
        _connecting(root, _Turn(number, incoming, outgoing, through), lanes)
        connection = _add(
            junction,
            "connection",
            id=number,
            incomingRoad=incoming,
            connectingRoad=number,
            contactPoint="start",
        )
        for lane in range(1, lanes + 1):
            _add(connection, "laneLink", from_=-lane * _turned(incoming), to=-lane)
    root.append(junction)
    return root


def _check_crosswalks(town: Town, placed: int) -> None:
    if placed < len(town.crosswalks):
        raise InputError(
            f"OpenDRIVE: expected crosswalks on a road, got {len(town.crosswalks) - placed} in the "
            "junction or beyond a street"
        )


def _reference_line(street: Street, start: float, end: float) -> paths.Piece:
    """The line between a street's two directions; start, end: metres along the street."""
    stretch = _stretch(street)
    return paths.Piece(
        street.pose(start, street.middle), (end - start) * stretch, street.curvature / stretch
    )


def _stretch(street: Street) -> float:
    """Metres of the reference line for a metre along the street.

    In a curve, the two are not equally long.
    """
    return 1 - street.curvature * street.middle


def _road(
    root: Xml.Element, number: str, line: paths.Piece, ahead: int, street: Street, **links: str
) -> Xml.Element:
    road = _add(root, "road", name=street.name, length=line.length, id=number, junction=-1)
    link = _add(road, "link")
    for kind, junction in links.items():
        _add(link, kind, elementType="junction", elementId=junction)
    _add(_add(road, "type", s=0.0, type="town"), "speed", max=50, unit="km/h")
    _geometry(_add(road, "planView"), 0.0, line)
    _lanes(road, ahead, pavement=True)
    return road


@dataclass(frozen=True)
class _Turn:
    """A connecting road: its number, the roads that it joins, and the points on its line."""

    number: str
    incoming: str
    outgoing: str
    through: Sequence[paths.Point]


def _connecting(root: Xml.Element, turn: _Turn, ahead: int) -> None:
    incoming, through = turn.incoming, turn.through
    path = paths.Path(through, radius=6.0) if len(through) > 2 else paths.Path(through)
    road = _add(root, "road", name="", length=path.length, id=turn.number, junction=JUNCTION_ID)
    link = _add(road, "link")
    _add(
        link,
        "predecessor",
        elementType="road",
        elementId=incoming,
        contactPoint="start" if incoming == "3" else "end",
    )
    _add(link, "successor", elementType="road", elementId=turn.outgoing, contactPoint="start")
    view, s = _add(road, "planView"), 0.0
    for piece in path.pieces:
        if piece.length < 1e-6:
            continue
        _geometry(view, s, piece)
        s += piece.length
    _lanes(road, ahead, pavement=False, turned=_turned(incoming))


def _turned(incoming: str) -> int:
    """-1 if the incoming road's line runs away from the junction, as the side street's does.

    Its lanes towards the junction are on the other side.
    """
    return -1 if incoming == "3" else 1


def _geometry(view: Xml.Element, s: float, piece: paths.Piece) -> None:
    start = piece.start
    geometry = _add(
        view, "geometry", s=s, x=start.x, y=start.y, hdg=float(start.heading), length=piece.length
    )
    if piece.curvature:
        _add(geometry, "arc", curvature=piece.curvature)
    else:
        _add(geometry, "line")


def _lanes(road: Xml.Element, ahead: int, pavement: bool, turned: int | None = None) -> None:
    """One lane to the left of the reference line, `ahead` lanes to its right, pavements outside.

    Args:
        turned: for a connecting road, which continues the lanes of the same number; -1 if the
            incoming road's lanes are seen from behind.
    """
    section = _add(_add(road, "lanes"), "laneSection", s=0.0)
    left = [(1, "driving", LANE_WIDTH)] + ([(2, "sidewalk", PAVEMENT_WIDTH)] if pavement else [])
    right = [(-i, "driving", LANE_WIDTH) for i in range(1, ahead + 1)] + (
        [(-ahead - 1, "sidewalk", PAVEMENT_WIDTH)] if pavement else []
    )
    for side, lanes in (("left", left[::-1]), ("center", [(0, "none", 0.0)]), ("right", right)):
        group = _add(section, side)
        for number, kind, width in lanes:
            lane = _add(group, "lane", id=number, type=kind, level="false")
            if turned and number:
                link = _add(lane, "link")
                _add(link, "predecessor", id=number * turned)
                _add(link, "successor", id=number)
            if number:
                _add(lane, "width", sOffset=0.0, a=width, b=0.0, c=0.0, d=0.0)
            broken = number == 0 or (kind == "driving" and number != -ahead and number < 0)
            _add(
                lane,
                "roadMark",
                sOffset=0.0,
                type="broken" if broken else "solid",
                weight="standard",
                color="standard",
                width=0.12,
            )


def _objects(road: Xml.Element, town: Town, street: Street, first: float) -> int:
    """The crosswalks on this road; returns their number.

    Args:
        first: metres along the street at which the road begins.
    """
    length = float(road.attrib["length"])
    wanted = [
        (c.at_m - street.start - first) * _stretch(street)
        for c in town.crosswalks
        if c.street == street.name
    ]
    inside = [s for s in wanted if 0 <= s <= length]
    if not inside:
        return 0
    objects = _add(road, "objects")
    for i, s in enumerate(inside):
        wide = street.right + street.left
        flat = {
            "t": (street.left - street.right) / 2 - street.middle,
            "zOffset": 0.0,
            "hdg": 0.0,
            "pitch": 0.0,
            "roll": 0.0,
            "orientation": "none",
        }
        crosswalk = _add(
            objects,
            "object",
            id=i,
            type="crosswalk",
            name="zebra",
            s=s,
            length=CROSSWALK_M,
            width=wide,
            **flat,
        )
        outline = _add(crosswalk, "outline", id=0)
        half = CROSSWALK_M / 2
        for u, v in ((-half, -wide / 2), (half, -wide / 2), (half, wide / 2), (-half, wide / 2)):
            _add(outline, "cornerLocal", u=u, v=v, z=0.0, height=0.0)
    return len(inside)


def open_scenario(
    scenario: FunctionalScenario, concrete: Mapping[str, Value], road_file: str
) -> Xml.Element:
    """The unbraked motion of all road users as trajectories over time, and the weather.

    Raises:
        InputError: if a variable is missing.
    """
    for name in (*WEATHER, *(WALK if scenario.has_pedestrian else ())):
        if name not in concrete:
            raise InputError(
                f"OpenSCENARIO needs the variable {name}, and the scenario's space has none"
            )
    root = Xml.Element("OpenSCENARIO")
    _add(
        root,
        "FileHeader",
        revMajor=1,
        revMinor=1,
        date=DATE,
        description=scenario.description,
        author="Blindspot",
    )
    _add(root, "ParameterDeclarations")
    _add(root, "CatalogLocations")
    _add(_add(root, "RoadNetwork"), "LogicFile", filepath=road_file)
    entities = _add(root, "Entities")
    _vehicle(entities, "ego", 2 * EGO_HALF_LENGTH_M, 2 * EGO_HALF_WIDTH_M, "car")
    for name, actor in scenario.actors.items():
        _vehicle(
            entities,
            name,
            2 * HALF_LENGTHS_M[actor.kind],
            2 * HALF_WIDTHS_M[actor.kind],
            "bus" if actor.kind == "bus" else "car",
        )
    if scenario.has_pedestrian:
        _pedestrian(entities)
    motions = _motions(scenario, concrete)
    storyboard = _add(root, "Storyboard")
    actions = _add(_add(storyboard, "Init"), "Actions")
    _environment(actions, concrete)
    for name, motion in motions.items():
        private = _add(actions, "Private", entityRef=name)
        teleport = _add(_add(private, "PrivateAction"), "TeleportAction")
        _position(teleport, motion[0])
    story = _add(storyboard, "Story", name="encounter")
    act = _add(story, "Act", name="encounter")
    for name, motion in motions.items():
        _maneuver(act, name, motion)
    _trigger(_add(act, "StartTrigger"), "begin", 0.0)
    _trigger(_add(storyboard, "StopTrigger"), "end", scenario.ego.horizon_s + 4)
    return root


Motion = list[tuple[float, paths.Pose]]
"""Seconds and poses."""


def _motions(scenario: FunctionalScenario, concrete: Mapping[str, Value]) -> dict[str, Motion]:
    """The unbraked poses of all road users until one second after the meeting."""
    end = scenario.ego.horizon_s + 1
    times = [round(0.1 * i, 1) for i in range(round(end / 0.1) + 1)]
    route, speed = scenario.ego.route(), scenario.ego.speed_kmh / 3.6
    motions = {"ego": [(t, route.at(scenario.start_s() + speed * t)) for t in times]}
    for name, actor in scenario.actors.items():
        path = actor.route()
        motions[name] = [(t, path.at(actor.travelled(t))) for t in times]
    if scenario.has_pedestrian:
        walking, shift = (float(concrete[name]) for name in WALK)
        motions["pedestrian"] = [(t, scenario.pedestrian_pose(t, walking, shift)) for t in times]
    return motions


def _pedestrian(entities: Xml.Element) -> None:
    owner = _add(entities, "ScenarioObject", name="pedestrian")
    walker = _add(
        owner,
        "Pedestrian",
        name="pedestrian",
        mass=75,
        model="pedestrian",
        pedestrianCategory="pedestrian",
    )
    _box(walker, 0.5, 0.5, 1.75)
    _add(walker, "Properties")


def _vehicle(entities: Xml.Element, name: str, length: float, width: float, category: str) -> None:
    vehicle = _add(
        _add(entities, "ScenarioObject", name=name), "Vehicle", name=name, vehicleCategory=category
    )
    _add(vehicle, "ParameterDeclarations")
    _box(vehicle, length, width, 3.05 if category == "bus" else 1.5)
    _add(vehicle, "Performance", maxSpeed=60, maxAcceleration=5, maxDeceleration=8)
    axles = _add(vehicle, "Axles")
    for kind, x in (("FrontAxle", 0.31 * length), ("RearAxle", -0.31 * length)):
        _add(
            axles,
            kind,
            maxSteering=0.5 if kind == "FrontAxle" else 0.0,
            wheelDiameter=0.64,
            trackWidth=width - 0.2,
            positionX=x,
            positionZ=0.32,
        )
    _add(vehicle, "Properties")


def _box(owner: Xml.Element, length: float, width: float, height: float) -> None:
    box = _add(owner, "BoundingBox")
    _add(box, "Center", x=0.0, y=0.0, z=height / 2)
    _add(box, "Dimensions", width=width, length=length, height=height)


def _position(parent: Xml.Element, timed: tuple[float, paths.Pose]) -> None:
    pose = timed[1]
    _add(
        _add(parent, "Position"),
        "WorldPosition",
        x=pose.x,
        y=pose.y,
        z=0.0,
        h=pose.heading,
        p=0.0,
        r=0.0,
    )


def _environment(actions: Xml.Element, concrete: Mapping[str, Value]) -> None:
    rain, fog = float(concrete["rain"]) / 100, float(concrete["fog"]) / 100
    action = _add(
        _add(_add(actions, "GlobalAction"), "EnvironmentAction"), "Environment", name="weather"
    )
    altitude = np.radians(float(concrete["sun_altitude"]))
    hour = 12 if altitude > 0 else 0
    _add(action, "TimeOfDay", animation="false", dateTime=f"2026-06-21T{hour:02d}:00:00")
    weather = _add(action, "Weather", cloudState="overcast" if max(rain, fog) > 0.5 else "free")
    # OpenSCENARIO measures azimuth clockwise from north (y), we counterclockwise from x.
    azimuth = float(np.radians((90 - float(concrete["sun_azimuth"])) % 360))
    _add(
        weather,
        "Sun",
        intensity=SUN_LUX * max(0.0, float(np.sin(altitude))),
        azimuth=azimuth,
        elevation=float(altitude),
    )
    _add(weather, "Fog", visualRange=visual_range_m(float(concrete["fog"])))
    _add(weather, "Precipitation", precipitationType="rain" if rain else "dry", intensity=rain)
    _add(action, "RoadCondition", frictionScaleFactor=1.0)


def _maneuver(act: Xml.Element, name: str, motion: Motion) -> None:
    group = _add(act, "ManeuverGroup", maximumExecutionCount=1, name=name)
    _add(_add(group, "Actors", selectTriggeringEntities="false"), "EntityRef", entityRef=name)
    event = _add(
        _add(group, "Maneuver", name=name),
        "Event",
        name=name,
        priority="overwrite",
        maximumExecutionCount=1,
    )
    routing = _add(_add(_add(event, "Action", name=name), "PrivateAction"), "RoutingAction")
    follow = _add(routing, "FollowTrajectoryAction")
    trajectory = _add(_add(follow, "TrajectoryRef"), "Trajectory", name=name, closed="false")
    _add(trajectory, "ParameterDeclarations")
    line = _add(_add(trajectory, "Shape"), "Polyline")
    for timed in motion:
        _position(_add(line, "Vertex", time=timed[0]), timed)
    _add(
        _add(follow, "TimeReference"),
        "Timing",
        domainAbsoluteRelative="absolute",
        scale=1.0,
        offset=0.0,
    )
    _add(follow, "TrajectoryFollowingMode", followingMode="position")
    _trigger(_add(event, "StartTrigger"), f"{name} begins", 0.0)


def _trigger(parent: Xml.Element, name: str, time_s: float) -> None:
    condition = _add(
        _add(parent, "ConditionGroup"), "Condition", name=name, delay=0.0, conditionEdge="none"
    )
    _add(
        _add(condition, "ByValueCondition"),
        "SimulationTimeCondition",
        value=float(time_s),
        rule="greaterThan",
    )
