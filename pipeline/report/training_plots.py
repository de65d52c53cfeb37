"""Figures of data and training: frames near the filter's thresholds, reliability, metrics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pipeline.artefacts.calibration_results import Diagram
from pipeline.core.lineage import Version
from pipeline.report.border import Case
from pipeline.report.style import INK, UNASSIGNED, legend_below, panels, series_colours, styled

KEPT, REJECTED, TRUTH = "#2a9d78", "#c9372c", "#468cff"
LABELLED = 5
"""With more bars side by side, their numbers would overlap."""
FEWEST = 10
"""Bins of a reliability diagram with fewer detections show chance and are left out."""


def border_sheet(cases: Sequence[Case], columns: int = 8) -> Figure:
    """Crops of frames near the filter's thresholds; green frame: kept, red frame: rejected."""
    lines = -(-len(cases) // columns)
    with styled():
        figure, axes = panels(max(1, lines), columns, width=1.2, height=1.4)
        for axis in (axis for line in axes for axis in line):
            axis.set_axis_off()
        for position, case in enumerate(cases):
            axis = axes[position // columns][position % columns]
            axis.set_axis_on()
            axis.imshow(case.crop, interpolation="bicubic")
            axis.set(xticks=[], yticks=[])
            axis.grid(False)
            for spine in axis.spines.values():
                spine.set(visible=True, color=KEPT if case.kept else REJECTED, linewidth=2.5)
            left, top, right, bottom = case.box
            width, height = right - left + 4, bottom - top + 4
            corner = (left - 2, top - 2)
            truth = Rectangle(corner, width, height, fill=False, color=TRUTH, linewidth=0.8)
            axis.add_patch(truth)
            numbers = f"{case.visible_pixels} px, contrast {case.contrast:.0f}"
            title = f"{case.test_id}\nstep {case.step}: {numbers}"
            axis.set_title(title, fontsize=5.5, fontweight="normal", loc="center")
    return figure


def reliability_diagrams(diagrams: Mapping[str, Mapping[str, Diagram]]) -> Figure:
    """Share of correct detections over their confidence.

    Left: the first version before and after calibration. Right: all versions after calibration.
    Versions that differ only by their seed share a colour.

    Args:
        diagrams: Version -> `uncalibrated` and `calibrated` -> rows of mean score, share of correct
            detections and their number.
    """
    first, groups = next(iter(diagrams)), [Version.named(version).group for version in diagrams]
    colours = series_colours(list(dict.fromkeys(groups)))
    with styled():
        figure, axes = panels(1, 2, width=4.0, height=3.4)
        shown: list[tuple[Axes, str, str, str, str]] = [
            (axes[0][0], first, groups[0], name, name) for name in diagrams[first]
        ]
        labels = [group if group not in groups[:rank] else "" for rank, group in enumerate(groups)]
        shown += [
            (axes[0][1], version, group, "calibrated", label)
            for version, group, label in zip(diagrams, groups, labels, strict=True)
        ]
        for axis, version, group, name, label in shown:
            bins = [row for row in diagrams[version].get(name, ()) if row[2] >= FEWEST]
            scores, right, counts = np.array(bins).reshape(-1, 3).T
            colour, style = (UNASSIGNED, "--") if name == "uncalibrated" else (colours[group], "-")
            line: dict[str, Any] = {"linestyle": style, "linewidth": 1.4, "label": label}
            axis.plot(scores, right, color=colour, clip_on=False, **line)
            sizes = 6 + 60 * counts / counts.max(initial=1)
            axis.scatter(scores, right, s=sizes, color=colour, zorder=3, clip_on=False)
        titles = (f"{first}, before and after calibration", "all versions, calibrated")
        for axis, title in zip(axes[0], titles, strict=True):
            axis.plot([0, 1], [0, 1], color=INK, linewidth=0.8, zorder=1)
            axis.set(title=title, xlabel="confidence", xlim=(0, 1), ylim=(0, 1))
            axis.legend(loc="upper left", fontsize=8)
        axes[0][0].set_ylabel("share of correct detections")
    return figure


def detection_bars(metrics: Mapping[str, Mapping[str, float]], names: Mapping[str, str]) -> Figure:
    """Detection metrics in [0, 1] of each version on the validation images.

    Versions that differ only by their seed share a colour.

    Args:
        metrics: Version -> metric -> value.
        names: Metric -> its printed name, in the order to draw.
    """
    groups = {version: Version.named(version).group for version in metrics}
    colours = series_colours(list(dict.fromkeys(groups.values())))
    width = 0.8 / max(1, len(metrics))
    with styled():
        figure, axes = panels(1, 1, width=9.2, height=2.9)
        axis = axes[0][0]
        for rank, (version, values) in enumerate(metrics.items()):
            positions = np.arange(len(names)) + (rank - (len(metrics) - 1) / 2) * width
            heights = [values.get(name, float("nan")) for name in names]
            group = groups[version]
            bars = axis.bar(positions, heights, width * 0.9, color=colours[group], label=group)
            if len(metrics) <= LABELLED:
                axis.bar_label(bars, fmt="%.2f", fontsize=7, padding=1)
        axis.set_xticks(range(len(names)), list(names.values()))
        axis.set_ylim(0, 1.08)
        axis.grid(False, axis="x")
        legend_below(figure, [axis])
    return figure
