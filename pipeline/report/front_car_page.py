"""The front-car study's page: which cells its points cover (Cheng et al., Table 1), how coverage grew (Figure 4), what detectors gained."""

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
from pipeline.core.constraints import Constraints
from pipeline.core.space import Ints, Space
from pipeline.core.statistics import wilson_interval
from pipeline.report.page import Drawing, Page, Part, Section, Table
from pipeline.report.style import GRID, INK, SERIES, panels, styled, svg

NOT_COVERABLE = "×"
EXISTING, GENERATED = SERIES[0], SERIES[1]
Pixels = NDArray[np.uint8]


def first_covering(categories: Ints, names: Sequence[str], sizes: Sequence[int], chosen: tuple[int, int]) -> list[list[str]]:
    """For each cell of two variables the name of the first point in it, empty if there is none."""
    rows, columns = (sizes[variable] for variable in chosen)
    cells = [[""] * columns for _ in range(rows)]
    for row, name in zip(categories[:, list(chosen)], names, strict=True):
        cells[row[0]][row[1]] = cells[row[0]][row[1]] or name
    return cells


def table(points: Points, categories: Ints, space: Space, constraints: Constraints) -> Figure:
    """One small table a plane of two conditions: the first point in each cell, or that no point can be there (the paper's Table 1)."""
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
            _small_table(axis, cells, constraints.feasible_cells(chosen), [space.variables[v].labels for v in chosen])
            axis.set_title(f"({chr(97 + index)}) " + " × ".join(space.names[v].replace("_", " ") for v in chosen))
    return figure


def _small_table(axis: Axes, cells: list[list[str]], feasible: NDArray[np.bool_], labels: list[tuple[str, ...]]) -> None:
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
            axis.axhspan(i - 0.42, i + 0.42, (j + 0.04) / len(row), (j + 0.96) / len(row), color=to_rgba(colour, 0.16), linewidth=0)
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
            (0, points.existing, EXISTING, "existing, drawn by lot"),
            (points.existing, len(shares), GENERATED, "proposed"),
        ):
            axis.scatter(places[low:high], shares[low:high], color=colour, s=42, zorder=3, label=label)
        for place, (share, point) in enumerate(zip(shares, points.points, strict=True)):
            axis.annotate(f"{point.covered}", (place, share), (0, 8), textcoords="offset points", ha="center", fontsize=8)
        axis.set_xticks(places, [point.name for point in points.points])
        axis.set(ylim=(0, 112), ylabel=f"{points.k}-projection coverage (%)", title=f"of {points.required} cells that can be covered")
        axis.legend(loc="lower right")
    return figure


def gallery(names: Sequence[str], images: Sequence[Pixels], classes: Sequence[Pixels], columns: int = 4) -> Figure:
    """The first snapshot of each point above its segmentation."""
    rows = -(-len(names) // columns)
    with styled({"axes.grid": False}):
        figure, axes = panels(rows, columns, width=2.9, height=3.7, sharey=False)
        for axis in (axis for row in axes for axis in row):
            axis.set_axis_off()
        for name, image, numbers, axis in zip(names, images, classes, (axis for row in axes for axis in row), strict=False):
            axis.imshow(np.vstack([image, SEGMENT_COLOURS[numbers]]), interpolation="antialiased")
            axis.set_title(name, color=EXISTING if name.startswith("E") else GENERATED)
    return figure


def by_condition(evaluation: Evaluation, space: Space, confidence: float) -> Figure:
    """On which share of the test snapshots each detector was right, for every value of every condition, with intervals."""
    rows = [(variable.name, label) for variable in space.variables for label in variable.labels]
    with styled():
        figure, axes = panels(1, 1, width=7.6, height=0.3 * len(rows) + 0.9)
        axis = axes[0][0]
        for index, (detector, colour) in enumerate(zip(evaluation.detectors, (EXISTING, GENERATED), strict=True)):
            for place, (name, label) in enumerate(rows):
                right = [right for point in detector.points if point.values[name] == label for right in point.right]
                low, high = wilson_interval(sum(right), len(right), confidence)
                share, y = sum(right) / len(right), place + 0.22 * (2 * index - 1) / 2
                axis.plot([100 * low, 100 * high], [y, y], color=colour, linewidth=1.6)
                label_once = f"learnt from {detector.learnt_points} points" if place == 0 else None
                axis.scatter([100 * share], [y], color=colour, s=22, zorder=3, label=label_once)
        axis.set_yticks(range(len(rows)), [f"{name.replace('_', ' ')}: {label}" for name, label in rows])
        axis.set(ylim=(len(rows) - 0.5, -0.5), xlabel="test snapshots judged rightly (%)")
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
    return figure


def page(study: str, points: Points, evaluation: Evaluation, figures: Mapping[str, Figure], confidence: float) -> Page:
    """The whole page; figures as the functions above draw them, by their names."""
    sections = (_coverage(points, figures), _snapshots(figures), _detectors(evaluation, figures, confidence))
    return Page(study, _headline(points, evaluation, confidence), sections, title="What does full coverage buy?")


def _headline(points: Points, evaluation: Evaluation, confidence: float) -> str:
    fewer, more = (np.mean(_right(detector)) for detector in evaluation.detectors)
    verdict = "more often right than" if more > fewer else "less often right than" if more < fewer else "as often right as"
    shown = "the difference is significant" if evaluation.p_value < 1 - confidence else "no difference is shown"
    return (
        f"{len(points.points) - points.existing} proposals bring {points.existing} random points to "
        f"{100 * points.points[-1].covered / points.required:.0f} % {points.k}-projection coverage. A detector that learnt from all of "
        f"them is {verdict} one that learnt as many images of the random points alone ({100 * more:.1f} against {100 * fewer:.1f} % "
        f"of {len(_right(evaluation.detectors[0]))} test snapshots; {shown}, p = {evaluation.p_value:.2g})."
    )


def _coverage(points: Points, figures: Mapping[str, Figure]) -> Section:
    conditions = tuple(points.points[0].values)
    rows = tuple((p.name, *(p.values[name] for name in conditions), f"{p.covered} of {points.required}") for p in points.points)
    listed = Table(("point", *(name.replace("_", " ") for name in conditions), "covered"), rows, numbers=(len(conditions) + 1,))
    how = (
        "Every two operating conditions make a plane; every pair of their values is a cell. A cell is covered if some point has both "
        "values. Each proposal is the feasible point that covers most new cells, found by 0-1 programming."
    )
    legend = f"The first point in each cell: E existing, G proposed; {NOT_COVERABLE} where the constraints allow no point."
    return Section(
        "Coverage",
        (how,),
        (
            Part(plots=(Drawing(svg(figures["growth"]), "Cells covered after each point."),)),
            Part(title="Points", table=listed),
            Part(title="Planes", plots=(Drawing(svg(figures["table"]), legend),)),
        ),
    )


def _snapshots(figures: Mapping[str, Figure]) -> Section:
    drawing = Drawing(svg(figures["gallery"]), "The first snapshot of each point, above its segmentation; yellow: the forward vehicle.")
    text = "What a point leaves open is drawn by lot: town, place, distances, vehicles, pedestrians, light."
    return Section("Snapshots", (text,), (Part(plots=(drawing,)),))


def _detectors(evaluation: Evaluation, figures: Mapping[str, Figure], confidence: float) -> Section:
    how = (
        "Two detectors of the vehicle ahead in the ego's lane, from the same weights, with the same number of images and of steps; only "
        "the points differ. They are tested in other towns, on the same number of snapshots of every feasible point. Right means: the "
        f"vehicle is found (score {evaluation.threshold:g}, IoU above 0.5) where there is one, and nothing else is. This is one draw of "
        "random points; another value of front_car.seed draws others."
    )
    names = ("ap50", "ap50_95", "precision", "recall", "false_positives_an_image")
    rows = []
    for detector in evaluation.detectors:
        right = _right(detector)
        low, high = wilson_interval(sum(right), len(right), confidence)
        share = f"{np.mean(right):.3f} ({low:.3f} to {high:.3f})"
        rows.append((f"{detector.learnt_points} points", f"{detector.images}", *(f"{detector.metrics[n]:.3f}" for n in names), share))
    headers = ("learnt from", "images", "AP50", "AP50-95", "precision", "recall", "false positives an image", "right, with interval")
    plot = Drawing(svg(figures["by_condition"]), f"Share of right snapshots by condition, with {100 * confidence:.0f} % intervals.")
    parts = (Part(table=Table(headers, tuple(rows), numbers=(7,))), Part(title="By operating condition", plots=(plot,)))
    return Section("Detectors", (how,), parts)


def _right(detector: DetectorResult) -> list[bool]:
    return [right for point in detector.points for right in point.right]
