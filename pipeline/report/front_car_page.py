"""The front-car study's page: covered cells, growth of coverage, detectors trained on the points.

Cheng et al., Table 1 and Figure 4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.artefacts.dataset import SEGMENT_COLOURS
from pipeline.artefacts.front_car_results import DetectorResult, Evaluation, Points
from pipeline.core.space import Ints, Space
from pipeline.report.page import Drawing, Page, Passage, Section, Table
from pipeline.report.style import GRID, INK, SERIES, panels, styled

NOT_COVERABLE = "×"
EXISTING, GENERATED = SERIES[0], SERIES[1]
Pixels = NDArray[np.uint8]


def first_covering(
    categories: Ints, names: Sequence[str], sizes: Sequence[int], chosen: tuple[int, int]
) -> list[list[str]]:
    """The name of the first point in each cell of two variables; empty if there is none.

    Args:
        categories: (n, d) category indices of the points.
        names: Names of the points, n.
        sizes: Number of categories of each variable, d.
        chosen: Indices of the two variables.
    """
    rows, columns = (sizes[variable] for variable in chosen)
    cells = [[""] * columns for _ in range(rows)]
    for row, name in zip(categories[:, list(chosen)], names, strict=True):
        cells[row[0]][row[1]] = cells[row[0]][row[1]] or name
    return cells


def table(points: Points, categories: Ints, space: Space) -> Figure:
    """A small table per plane of two conditions: the first point in each cell (Table 1)."""
    planes = list(combinations(range(len(space)), 2))
    names = [point.name for point in points.points]
    with styled({"axes.grid": False, "axes.titlesize": 9}):
        figure, axes = panels(-(-len(planes) // 3), 3, width=3.3, height=1.35, sharey=False)
        for index, axis in enumerate(axis for row in axes for axis in row):
            if index >= len(planes):
                axis.set_visible(False)
                continue
            chosen = planes[index]
            cells = first_covering(categories, names, space.sizes, chosen)
            labels = [space.variables[v].labels for v in chosen]
            _small_table(axis, cells, space.constraints.feasible_cells(chosen), labels)
            conditions = (space.names[v].replace("_", " ") for v in chosen)
            axis.set_title(f"({chr(97 + index)}) {' × '.join(conditions)}")
    return figure


def _small_table(
    axis: Axes, cells: list[list[str]], feasible: NDArray[np.bool_], labels: list[tuple[str, ...]]
) -> None:
    axis.set(xlim=(-0.5, len(labels[1]) - 0.5), ylim=(len(labels[0]) - 0.5, -0.5))
    axis.set_xticks(range(len(labels[1])), labels[1])
    axis.set_yticks(range(len(labels[0])), labels[0])
    axis.xaxis.tick_top()
    axis.tick_params(length=0)
    for spine in axis.spines.values():
        spine.set_visible(False)
    for i, row in enumerate(cells):
        for j, name in enumerate(row):
            text, colour = name, _colour(name)
            if not feasible[i, j]:
                text, colour = NOT_COVERABLE, GRID
            left, right = (j + 0.04) / len(row), (j + 0.96) / len(row)
            shade = to_rgba(colour, 0.16)
            axis.axhspan(i - 0.42, i + 0.42, left, right, color=shade, linewidth=0)
            axis.text(j, i, text, ha="center", va="center", color=INK)


def _colour(name: str) -> str:
    """The colour of an existing point, such as E1, or of a generated one."""
    return EXISTING if name.startswith("E") else GENERATED


def growth(points: Points) -> Figure:
    """Coverage after each point (the paper's Figure 4)."""
    shares = [100 * point.covered / points.required for point in points.points]
    with styled():
        figure, axes = panels(1, 1, width=7.6, height=3.2)
        axis = axes[0][0]
        places = np.arange(len(shares))
        axis.plot(places, shares, color=INK, linewidth=1.2, zorder=2)
        for part, colour, label in (
            (slice(0, points.existing), EXISTING, "existing (random)"),
            (slice(points.existing, len(shares)), GENERATED, "proposed"),
        ):
            axis.scatter(places[part], shares[part], color=colour, s=42, zorder=3, label=label)
        above: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": 8}
        for place, (share, point) in enumerate(zip(shares, points.points, strict=True)):
            axis.annotate(f"{point.covered}", (place, share), (0, 8), **above)
        axis.set_xticks(places, [point.name for point in points.points])
        title = f"{points.required} feasible cells"
        axis.set(ylim=(0, 112), ylabel=f"{points.k}-projection coverage (%)", title=title)
        axis.legend(loc="lower right")
    return figure


def gallery(
    names: Sequence[str], images: Sequence[Pixels], classes: Sequence[Pixels], columns: int = 4
) -> Figure:
    """The first snapshot of each point above its segmentation."""
    rows = -(-len(names) // columns)
    with styled({"axes.grid": False}):
        figure, axes = panels(rows, columns, width=2.9, height=3.7, sharey=False)
        flat = [axis for row in axes for axis in row]
        for axis in flat:
            axis.set_axis_off()
        for name, image, numbers, axis in zip(names, images, classes, flat, strict=False):
            axis.imshow(np.vstack([image, SEGMENT_COLOURS[numbers]]), interpolation="antialiased")
            axis.set_title(name, color=_colour(name))
    return figure


def by_condition(evaluation: Evaluation, space: Space) -> Figure:
    """Share of test snapshots on which each detector is right, for each value of each condition.

    There are no intervals: the snapshots share a few towns and are spread evenly over the points,
    so they are no independent samples. Values without a feasible point are left out.
    """
    tested: set[tuple[str, str]] = set()
    for detector in evaluation.detectors:
        for point in detector.points:
            tested.update(point.values.items())
    rows = []
    for variable in space.variables:
        rows += [(variable.name, label) for label in variable.labels]
    rows = [row for row in rows if row in tested]
    with styled():
        figure, axes = panels(1, 1, width=7.6, height=0.3 * len(rows) + 0.9)
        axis = axes[0][0]
        colours = (EXISTING, GENERATED)
        for index, (detector, colour) in enumerate(zip(evaluation.detectors, colours, strict=True)):
            for place, (name, label) in enumerate(rows):
                right: list[bool] = []
                for point in detector.points:
                    if point.values[name] == label:
                        right += point.right
                share, y = sum(right) / len(right), place + 0.22 * (2 * index - 1) / 2
                label_once = f"trained on {detector.learnt_points} points" if place == 0 else None
                axis.scatter([100 * share], [y], color=colour, s=22, zorder=3, label=label_once)
        ticks = [f"{name.replace('_', ' ')}: {label}" for name, label in rows]
        axis.set_yticks(range(len(rows)), ticks)
        axis.set(ylim=(len(rows) - 0.5, -0.5), xlabel="share of right test snapshots (%)")
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    return figure


def page(study: str, points: Points, evaluation: Evaluation, figures: Mapping[str, Figure]) -> Page:
    """The whole page. figures: name of a drawing function above -> its figure."""
    text = (
        "A point fixes the conditions. Town, place, distances, vehicles, pedestrians and light are "
        "random."
    )
    how = "The first snapshot of each point, above its segmentation. Yellow: the forward vehicle."
    gallery_part = Passage(plots=(Drawing.of(figures["gallery"], how),))
    sections = (
        _coverage(points, figures),
        Section("Snapshots", (text,), (gallery_part,)),
        _detectors(evaluation, figures),
    )
    title = "Does full coverage make a better detector?"
    return Page(study, _headline(points, evaluation), sections, title=title)


def _headline(points: Points, evaluation: Evaluation) -> str:
    """The result without a statistical test: the snapshots are no independent samples."""
    fewer, more = (np.mean(_right(detector)) for detector in evaluation.detectors)
    covered = 100 * points.points[-1].covered / points.required
    return (
        f"{len(points.points) - points.existing} proposed points bring {points.existing} random "
        f"points to {covered:.0f} % {points.k}-projection coverage. Trained on all points, the "
        f"detector is right on {100 * more:.1f} % of {len(_right(evaluation.detectors[0]))} test "
        "snapshots. Trained on as many images of the random points alone, it is right on "
        f"{100 * fewer:.1f} %. One draw of random points cannot show a difference."
    )


def _coverage(points: Points, figures: Mapping[str, Figure]) -> Section:
    conditions = tuple(points.points[0].values)
    rows = []
    for point in points.points:
        values = (point.values[name] for name in conditions)
        rows.append((point.name, *values, f"{point.covered} of {points.required}"))
    headers = ("point", *(name.replace("_", " ") for name in conditions), "covered")
    listed = Table(headers, tuple(rows), numbers=(len(conditions) + 1,))
    how = (
        "Two operating conditions form a plane; each pair of their values is a cell. A cell is "
        "covered if a point has both values. Each proposal is the feasible point that covers the "
        "most new cells, found by 0-1 programming."
    )
    legend = (
        f"The first point in each cell. E: existing. G: proposed. {NOT_COVERABLE}: infeasible, "
        "because of a constraint."
    )
    cells = Drawing.of(figures["growth"], "Number of cells covered after each point.")
    parts = (
        Passage(plots=(cells,)),
        Passage(title="Points", table=listed),
        Passage(title="Planes", plots=(Drawing.of(figures["table"], legend),)),
    )
    return Section("Coverage", (how,), parts)


def _detectors(evaluation: Evaluation, figures: Mapping[str, Figure]) -> Section:
    how = (
        "Both detectors look for the vehicle ahead in the ego's lane. They start from the same "
        "weights and train on as many images for as many steps; only the points differ. The test "
        "snapshots show other towns, with the same number for every feasible point. A snapshot is "
        f"right if the vehicle is detected (score {evaluation.threshold:g}, IoU above 0.5) where "
        "there is one, and nothing else is. Change front_car.seed for another draw of random "
        "points."
    )
    metrics = {
        "ap50": "AP50",
        "ap50_95": "AP50-95",
        "precision": "precision",
        "recall": "recall",
        "false_positives_an_image": "false positives per image",
    }
    rows = []
    for detector in evaluation.detectors:
        numbers = (f"{detector.metrics[name]:.3f}" for name in metrics)
        points, share = f"{detector.learnt_points} points", f"{np.mean(_right(detector)):.3f}"
        rows.append((points, f"{detector.images}", *numbers, share))
    headers = ("trained on", "images", *metrics.values(), "right snapshots")
    plot = Drawing.of(figures["by_condition"], "Share of right snapshots by condition.")
    parts = (
        Passage(table=Table(headers, tuple(rows), numbers=(7,))),
        Passage(title="By operating condition", plots=(plot,)),
    )
    return Section("Detectors", (how,), parts)


def _right(detector: DetectorResult) -> list[bool]:
    """Whether the detector is right, for each test snapshot."""
    return [right for point in detector.points for right in point.right]
