"""The front-car study's page: covered cells (Cheng et al., Table 1), growth of coverage (Figure 4), detectors trained on the points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

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
    """The name of the first point in each cell of two variables; empty if there is none."""
    rows, columns = (sizes[variable] for variable in chosen)
    cells = [[""] * columns for _ in range(rows)]
    for row, name in zip(categories[:, list(chosen)], names, strict=True):
        cells[row[0]][row[1]] = cells[row[0]][row[1]] or name
    return cells


def table(points: Points, categories: Ints, space: Space) -> Figure:
    """A small table per plane of two conditions: the first point in each cell, or that the cell is infeasible (the paper's Table 1)."""
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
            _small_table(
                axis,
                cells,
                space.constraints.feasible_cells(chosen),
                [space.variables[v].labels for v in chosen],
            )
            axis.set_title(
                f"({chr(97 + index)}) "
                + " × ".join(space.names[v].replace("_", " ") for v in chosen)
            )
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
            text = name if feasible[i, j] else NOT_COVERABLE
            colour = GRID if not feasible[i, j] else EXISTING if name.startswith("E") else GENERATED
            axis.axhspan(
                i - 0.42,
                i + 0.42,
                (j + 0.04) / len(row),
                (j + 0.96) / len(row),
                color=to_rgba(colour, 0.16),
                linewidth=0,
            )
            axis.text(j, i, text, ha="center", va="center", color=INK)


def growth(points: Points) -> Figure:
    """Coverage after each point (the paper's Figure 4)."""
    shares = [100 * point.covered / points.required for point in points.points]
    with styled():
        figure, axes = panels(1, 1, width=7.6, height=3.2)
        axis = axes[0][0]
        places = np.arange(len(shares))
        axis.plot(places, shares, color=INK, linewidth=1.2, zorder=2)
        for low, high, colour, label in (
            (0, points.existing, EXISTING, "existing (random)"),
            (points.existing, len(shares), GENERATED, "proposed"),
        ):
            axis.scatter(
                places[low:high], shares[low:high], color=colour, s=42, zorder=3, label=label
            )
        for place, (share, point) in enumerate(zip(shares, points.points, strict=True)):
            axis.annotate(
                f"{point.covered}",
                (place, share),
                (0, 8),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
        axis.set_xticks(places, [point.name for point in points.points])
        axis.set(
            ylim=(0, 112),
            ylabel=f"{points.k}-projection coverage (%)",
            title=f"{points.required} feasible cells",
        )
        axis.legend(loc="lower right")
    return figure


def gallery(
    names: Sequence[str], images: Sequence[Pixels], classes: Sequence[Pixels], columns: int = 4
) -> Figure:
    """The first snapshot of each point above its segmentation."""
    rows = -(-len(names) // columns)
    with styled({"axes.grid": False}):
        figure, axes = panels(rows, columns, width=2.9, height=3.7, sharey=False)
        for axis in (axis for row in axes for axis in row):
            axis.set_axis_off()
        for name, image, numbers, axis in zip(
            names, images, classes, (axis for row in axes for axis in row), strict=False
        ):
            axis.imshow(np.vstack([image, SEGMENT_COLOURS[numbers]]), interpolation="antialiased")
            axis.set_title(name, color=EXISTING if name.startswith("E") else GENERATED)
    return figure


def by_condition(evaluation: Evaluation, space: Space) -> Figure:
    """Share of test snapshots on which each detector is right, for every value of every condition that a feasible point has.

    Without intervals: the snapshots share a few towns and are spread evenly over the points, so they are no independent samples."""
    tested = {
        value
        for detector in evaluation.detectors
        for point in detector.points
        for value in point.values.items()
    }
    rows = [
        (variable.name, label)
        for variable in space.variables
        for label in variable.labels
        if (variable.name, label) in tested
    ]
    with styled():
        figure, axes = panels(1, 1, width=7.6, height=0.3 * len(rows) + 0.9)
        axis = axes[0][0]
        for index, (detector, colour) in enumerate(
            zip(evaluation.detectors, (EXISTING, GENERATED), strict=True)
        ):
            for place, (name, label) in enumerate(rows):
                right = [
                    right
                    for point in detector.points
                    if point.values[name] == label
                    for right in point.right
                ]
                share, y = sum(right) / len(right), place + 0.22 * (2 * index - 1) / 2
                label_once = f"trained on {detector.learnt_points} points" if place == 0 else None
                axis.scatter([100 * share], [y], color=colour, s=22, zorder=3, label=label_once)
        axis.set_yticks(
            range(len(rows)), [f"{name.replace('_', ' ')}: {label}" for name, label in rows]
        )
        axis.set(ylim=(len(rows) - 0.5, -0.5), xlabel="share of right test snapshots (%)")
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    return figure


def page(study: str, points: Points, evaluation: Evaluation, figures: Mapping[str, Figure]) -> Page:
    """The whole page. figures: name of a drawing function above -> its figure."""
    sections = (_coverage(points, figures), _snapshots(figures), _detectors(evaluation, figures))
    return Page(
        study,
        _headline(points, evaluation),
        sections,
        title="Does full coverage make a better detector?",
    )


def _headline(points: Points, evaluation: Evaluation) -> str:
    """Without a test: the snapshots are no independent samples, and one draw of points shows nothing."""
    fewer, more = (np.mean(_right(detector)) for detector in evaluation.detectors)
    covered = 100 * points.points[-1].covered / points.required
    return (
        f"{len(points.points) - points.existing} proposed points bring {points.existing} random points to {covered:.0f} % "
        f"{points.k}-projection coverage. Trained on all points, the detector is right on {100 * more:.1f} % of "
        f"{len(_right(evaluation.detectors[0]))} test snapshots. Trained on as many images of the random points alone, it is right on "
        f"{100 * fewer:.1f} %. One draw of random points cannot show a difference."
    )


def _coverage(points: Points, figures: Mapping[str, Figure]) -> Section:
    conditions = tuple(points.points[0].values)
    rows = tuple(
        (p.name, *(p.values[name] for name in conditions), f"{p.covered} of {points.required}")
        for p in points.points
    )
    listed = Table(
        ("point", *(name.replace("_", " ") for name in conditions), "covered"),
        rows,
        numbers=(len(conditions) + 1,),
    )
    how = (
        "Two operating conditions form a plane; each pair of their values is a cell. A cell is covered if a point has both values. Each "
        "proposal is the feasible point that covers the most new cells, found by 0-1 programming."
    )
    legend = f"The first point in each cell. E: existing. G: proposed. {NOT_COVERABLE}: infeasible, because of a constraint."
    return Section(
        "Coverage",
        (how,),
        (
            Passage(
                plots=(Drawing.of(figures["growth"], "Number of cells covered after each point."),)
            ),
            Passage(title="Points", table=listed),
            Passage(title="Planes", plots=(Drawing.of(figures["table"], legend),)),
        ),
    )


def _snapshots(figures: Mapping[str, Figure]) -> Section:
    drawing = Drawing.of(
        figures["gallery"],
        "The first snapshot of each point, above its segmentation. Yellow: the forward vehicle.",
    )
    text = "A point fixes the conditions. Town, place, distances, vehicles, pedestrians and light are random."
    return Section("Snapshots", (text,), (Passage(plots=(drawing,)),))


def _detectors(evaluation: Evaluation, figures: Mapping[str, Figure]) -> Section:
    how = (
        "Both detectors look for the vehicle ahead in the ego's lane. They start from the same weights and train on as many images for "
        "as many steps; only the points differ. The test snapshots show other towns, with the same number for every feasible point. A "
        f"snapshot is right if the vehicle is detected (score {evaluation.threshold:g}, IoU above 0.5) where there is one, and nothing "
        "else is. Change front_car.seed for another draw of random points."
    )
    names = ("ap50", "ap50_95", "precision", "recall", "false_positives_an_image")
    rows = []
    for detector in evaluation.detectors:
        right = _right(detector)
        share = f"{np.mean(right):.3f}"
        rows.append(
            (
                f"{detector.learnt_points} points",
                f"{detector.images}",
                *(f"{detector.metrics[n]:.3f}" for n in names),
                share,
            )
        )
    headers = (
        "trained on",
        "images",
        "AP50",
        "AP50-95",
        "precision",
        "recall",
        "false positives per image",
        "right snapshots",
    )
    plot = Drawing.of(figures["by_condition"], "Share of right snapshots by condition.")
    parts = (
        Passage(table=Table(headers, tuple(rows), numbers=(7,))),
        Passage(title="By operating condition", plots=(plot,)),
    )
    return Section("Detectors", (how,), parts)


def _right(detector: DetectorResult) -> list[bool]:
    return [right for point in detector.points for right in point.right]
