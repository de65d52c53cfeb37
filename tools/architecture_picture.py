"""Draw docs/images/architecture.svg: the steps of a study, and one test's way through the rooms.

The steps and their order follow from what they read and write, the floors from the layers of
import-linter in pyproject.toml. The text is the same on every machine.

Usage: python tools/architecture_picture.py [FILE]
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from pathlib import Path

from pipeline.config.composing import compose
from pipeline.workflow.jobs import Jobs, Target, step_names

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs/images/architecture.svg"
STUDY = "default"
HELD_OUT = "held_out"
SUFFIX = ", held out"

WIDTH, MARGIN, LABEL = 1360, 16, 190
"""Pixels of the picture, around it, and of the names of the floors."""
ROW, NODE_WIDTH, NODE_HEIGHT = 46, 96, 36
"""Pixels of the steps: distance of rows, width and height of a box."""
THIN, TALL = 24, 88
"""Pixels of a floor that the test does not enter, and of one that it does."""
STATION_WIDTH, STATION_HEIGHT = 136, 62
NODE_PITCH = (WIDTH - MARGIN - LABEL - NODE_WIDTH - 12) / 8
LEGEND = (
    "Grey: a step reads what an earlier one wrote.",
    "Red: the way of one test, 1 to 9.",
    "Imports point down.",
)

ROWS = {
    "define_space": 0,
    "measure": 0,
    "cluster": 2,
    "evidence": 3,
    "white_box": 4,
}
"""Rows of steps beside the main line, which is row 1."""
MAIN_ROW = 1

INK, SOFT, LINE = "#1f2937", "#6b7280", "#94a3b8"
FLOOR, USED, STEPS = "#f8fafc", "#eef4fb", "#fdf6e9"
BOX, BORDER, ACCENT = "#ffffff", "#64748b", "#c2410c"
CENTRED, BOLD = ' text-anchor="middle"', ' font-weight="600"'
FONT = "'Helvetica Neue', Helvetica, Arial, 'Liberation Sans', sans-serif"


@dataclass(frozen=True)
class Node:
    """A step in the picture: its name, its column and row, and the file or folder that it makes."""

    name: str
    column: int
    row: int
    makes: str


@dataclass(frozen=True)
class Station:
    """A place that a test passes: a module or package, what happens there, and its column."""

    module: str
    text: str
    column: int
    number: int | None
    columns: int = 1

    @property
    def room(self) -> str:
        """The package directly below `pipeline`."""
        return self.module.split("/")[0]


STATIONS = (
    Station("execution/campaign.py", "asks the strategy", 0, 1),
    Station("core/samplers", "proposes points", 0, 2),
    Station("core/space.py", "decodes a point", 1, 3),
    Station("execution/workers.py", "starts the test", 1, 4),
    Station("core/loop.py", "run_test(world, detector, car)", 2, 5, 2),
    Station("simulators", "observe, advance", 2, None),
    Station("detectors", "image to boxes", 3, None),
    Station("core/kpi.py", "judges the episode", 4, 6),
    Station("execution/journal.py", "keeps the test", 4, 7),
    Station("artefacts/tables.py", "tests.parquet", 5, 8),
    Station("analysis", "regions, verdict", 6, 9),
)
"""In the order in which a test passes them; a station without a number belongs to the loop."""
STATION_PITCH = (WIDTH - MARGIN - LABEL - 12) / 7
JUDGING = ("measure", "cluster", "compare")
"""The steps that judge the tests of a campaign."""


def layers() -> list[list[str]]:
    """The floors from top to bottom, each with its rooms, as pyproject.toml declares them."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())
    contracts = declared["tool"]["importlinter"]["contracts"]
    floors = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    return [floor.split(" | ") for floor in floors]


def steps_of_study() -> tuple[list[Node], list[tuple[Node, Node]]]:
    """The steps of the default study, and the pairs of which one reads what the other writes.

    Pairs that follow from others are left out.
    """
    jobs = Jobs(compose(STUDY, []), step_names())
    makes: dict[str, str] = {}
    reads: dict[str, set[str]] = {}
    for job, outputs in jobs.in_order():
        name = _node_name(job)
        folder, _, below = outputs[0].removeprefix(f"{jobs.folders.root}/").partition("/")
        makes.setdefault(name, f"{folder}/" if below else folder)
        sources = reads.setdefault(name, set())
        for path in jobs.inputs(job):
            maker = jobs.maker(path)
            if maker is not None:
                sources.add(_node_name(maker))
        sources.discard(name)
    nodes = _placed(makes, reads)
    arrows = []
    for name, sources in reads.items():
        for source in sorted(sources):
            if not any(source in _before(other, reads) for other in sources):
                arrows.append((nodes[source], nodes[name]))
    return list(nodes.values()), arrows


def _node_name(job: Target) -> str:
    """The step's name; the campaigns of held-out tests are a node of their own."""
    held_out = dict(job.wildcards).get("kind") == HELD_OUT
    return job.step + SUFFIX if held_out else job.step


def _before(name: str, reads: Mapping[str, set[str]]) -> set[str]:
    """All steps that come before a step."""
    before = set(reads[name])
    for source in reads[name]:
        before |= _before(source, reads)
    return before


def _placed(makes: Mapping[str, str], reads: Mapping[str, set[str]]) -> dict[str, Node]:
    """Each step in the column after the last step that it reads from."""
    columns: dict[str, int] = {}

    def column(name: str) -> int:
        if name not in columns:
            columns[name] = max((column(source) + 1 for source in reads[name]), default=0)
        return columns[name]

    placed = {}
    taken: set[tuple[int, int]] = set()
    for name, output in makes.items():
        row = ROWS.get(name, MAIN_ROW)
        while (column(name), row) in taken:
            row += 1
        taken.add((column(name), row))
        placed[name] = Node(name, column(name), row, output)
    return placed


class Drawing:
    """Collects the elements of an SVG."""

    def __init__(self) -> None:
        self.elements: list[str] = []

    def box(
        self, x: float, y: float, width: float, height: float, fill: str, border: str = "none"
    ) -> None:
        """A rectangle with round corners; x, y: its upper left corner."""
        self.elements.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="6" '
            f'fill="{fill}" stroke="{border}"/>'
        )

    def text(
        self, x: float, y: float, words: str, size: int, color: str = INK, style: str = ""
    ) -> None:
        """One line; x, y: its anchor and baseline. style: further attributes."""
        self.elements.append(
            f'<text x="{x:g}" y="{y:g}" font-size="{size}" fill="{color}"{style}>'
            f"{escape(words)}</text>"
        )

    def arrow(self, path: str, color: str = LINE, both: bool = False) -> None:
        """A line along an SVG path with a head at its end, or at both ends."""
        name = "accent" if color == ACCENT else "line"
        start = f' marker-start="url(#{name})"' if both else ""
        self.elements.append(
            f'<path d="{path}" fill="none" stroke="{color}" stroke-width="1.6"'
            f'{start} marker-end="url(#{name})"/>'
        )

    def dot(self, x: float, y: float, number: int) -> None:
        """A number in a disc."""
        self.elements.append(f'<circle cx="{x:g}" cy="{y:g}" r="10" fill="{ACCENT}"/>')
        self.text(x, y + 4, str(number), 12, "#ffffff", CENTRED + BOLD)

    def svg(self, height: float) -> str:
        """The whole file."""
        heads = "".join(
            f'<marker id="{name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" '
            f'markerHeight="8" markerUnits="userSpaceOnUse" orient="auto-start-reverse">'
            f'<path d="M0,0.6 L8,4 L0,7.4 z" fill="{color}"/></marker>'
            for name, color in (("line", LINE), ("accent", ACCENT))
        )
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:g}" '
                f'width="{WIDTH}" height="{height:g}" font-family="{FONT}" role="img">',
                "<title>The steps of a study, and one test's way through the rooms</title>",
                f"<defs>{heads}</defs>",
                f'<rect width="{WIDTH}" height="{height:g}" fill="#ffffff"/>',
                *self.elements,
                "</svg>\n",
            ]
        )


def picture() -> str:
    """The text of the SVG."""
    nodes, arrows = steps_of_study()
    drawing = Drawing()
    used = {station.room for station in STATIONS}
    rows = 1 + max(node.row for node in nodes)
    tops: dict[str, float] = {}
    heights: dict[str, float] = {}
    y = float(MARGIN)
    for rooms in layers():
        height, fill = (TALL, USED) if used & set(rooms) else (THIN, FLOOR)
        if "steps" in rooms:
            height, fill = rows * ROW + 14, STEPS
        drawing.box(MARGIN, y, WIDTH - 2 * MARGIN, height, fill)
        _floor_name(drawing, rooms, y, height)
        for room in rooms:
            tops[room], heights[room] = y, height
        y += height + 4
    _draw_steps(drawing, nodes, arrows, tops["steps"])
    for number, line in enumerate(LEGEND):
        drawing.text(LABEL, tops["steps"] + 12 + 2 * ROW + 20 + 18 * number, line, 12, SOFT)
    centres = {
        station.module: (
            LABEL + station.column * STATION_PITCH + _station_width(station) / 2,
            tops[station.room] + heights[station.room] / 2,
        )
        for station in STATIONS
    }
    campaign = next(node for node in nodes if node.name == "campaign")
    _draw_way(drawing, centres, campaign, tops["steps"], heights["steps"])
    for station in STATIONS:
        _draw_station(drawing, station, *centres[station.module])
    return drawing.svg(y - 4 + MARGIN)


def _floor_name(drawing: Drawing, rooms: Sequence[str], y: float, height: float) -> None:
    """The rooms of a floor, at most two a line."""
    lines = [" · ".join(rooms[start : start + 2]) for start in range(0, len(rooms), 2)]
    first = y + height / 2 + 4 - 8 * (len(lines) - 1)
    for number, line in enumerate(lines):
        drawing.text(MARGIN + 12, first + 16 * number, line, 12, SOFT, BOLD)


def _node_corner(node: Node, top: float) -> tuple[float, float]:
    """The upper left corner of a step's box."""
    return LABEL + node.column * NODE_PITCH, top + 12 + node.row * ROW


def _draw_steps(
    drawing: Drawing, nodes: Sequence[Node], arrows: Sequence[tuple[Node, Node]], top: float
) -> None:
    for source, target in arrows:
        x, y = _node_corner(source, top)
        end_x, end_y = _node_corner(target, top)
        x, y, end_y = x + NODE_WIDTH, y + NODE_HEIGHT / 2, end_y + NODE_HEIGHT / 2
        turn = end_x - 30
        middle = end_x - 15
        drawing.arrow(
            f"M{x:g},{y:g} H{turn:g} C{middle:g},{y:g} {middle:g},{end_y:g} {end_x:g},{end_y:g}"
        )
    for node in nodes:
        x, y = _node_corner(node, top)
        drawing.box(x, y, NODE_WIDTH, NODE_HEIGHT, BOX, BORDER)
        name = node.name.removesuffix(SUFFIX)  # The folder tells the two campaigns apart.
        drawing.text(x + NODE_WIDTH / 2, y + 15, name, 12, INK, CENTRED + BOLD)
        drawing.text(x + NODE_WIDTH / 2, y + 29, node.makes, 10, SOFT, CENTRED)


def _station_width(station: Station) -> float:
    """A station's box spans its columns, without the gap after the last one."""
    return STATION_WIDTH + (station.columns - 1) * STATION_PITCH


def _draw_station(drawing: Drawing, station: Station, x: float, y: float) -> None:
    width = _station_width(station)
    border = BORDER if station.number is None else ACCENT
    drawing.box(x - width / 2, y - STATION_HEIGHT / 2, width, STATION_HEIGHT, BOX, border)
    _, _, name = station.module.rpartition("/")
    if name == station.room:
        drawing.text(x, y - 4, name, 13, INK, CENTRED + BOLD)
        drawing.text(x, y + 15, station.text, 11, SOFT, CENTRED)
    else:
        drawing.text(x, y - 14, f"{station.room}/", 10, SOFT, CENTRED)
        drawing.text(x, y + 2, name, 13, INK, CENTRED + BOLD)
        drawing.text(x, y + 19, station.text, 11, SOFT, CENTRED)
    if station.number is not None:
        drawing.dot(x - width / 2, y - STATION_HEIGHT / 2, station.number)


def _draw_way(
    drawing: Drawing,
    centres: Mapping[str, tuple[float, float]],
    campaign: Node,
    top: float,
    height: float,
) -> None:
    """The arrows between the stations."""
    half_height = STATION_HEIGHT / 2
    x, y = _node_corner(campaign, top)
    first_x, first_y = centres["execution/campaign.py"]
    below = top + height - 12
    drawing.arrow(
        f"M{x + NODE_WIDTH / 2:g},{y + NODE_HEIGHT:g} V{below:g} H{first_x:g} "
        f"V{first_y - half_height:g}",
        ACCENT,
    )
    for source, target in pairwise(station for station in STATIONS if station.number):
        (x, y), (end_x, end_y) = centres[source.module], centres[target.module]
        if x == end_x:
            sign = 1 if end_y > y else -1
            path = f"M{x:g},{y + sign * half_height:g} V{end_y - sign * half_height:g}"
        else:
            x += _station_width(source) / 2
            end_x -= _station_width(target) / 2
            path = f"M{x:g},{y:g} H{end_x:g}"
            if y != end_y:
                turn = (x + end_x) / 2
                path = f"M{x:g},{y:g} H{turn:g} V{end_y:g} H{end_x:g}"
        drawing.arrow(path, ACCENT)
    loop_y = centres["core/loop.py"][1]
    for station in STATIONS:
        if station.number is None:
            x, y = centres[station.module]
            drawing.arrow(
                f"M{x:g},{y + half_height:g} V{loop_y - half_height:g}", ACCENT, both=True
            )
    x, y = centres["analysis"]
    drawing.arrow(f"M{x:g},{y - half_height:g} V{below - 6:g}", ACCENT)
    drawing.text(x, below - 14, ", ".join(JUDGING), 12, INK, CENTRED + BOLD)


def main(words: Sequence[str]) -> int:
    """Write the picture and print its path."""
    path = Path(words[0]) if words else PICTURE
    path.write_text(picture())
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
