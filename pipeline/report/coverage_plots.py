"""Figures of coverage: a heat map of each plane of two conditions, coverage over points.

Cheng et al., Table 1 and Figure 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.analysis.pair_shares import PairShare
from pipeline.core.coverage.projection import Plane
from pipeline.core.space import Space
from pipeline.report.style import INK, PAGE_INCHES, SERIES, panels, styled, whole_numbers

COLUMNS = 5
MOST_PLANES = 60
MOST_LABELS = 16
SHADES = LinearSegmentedColormap.from_list("coverage", ["#e9927f", "#f6e3ac", "#b5dcc0"])


def heat_maps(planes: Sequence[Plane], space: Space) -> Figure:
    """Coverage of each cell of each plane of two conditions, least covered planes first.

    Grey cells have no feasible point, or require none.
    """
    shown = sorted(planes, key=lambda plane: plane.coverage.ratio if plane.coverage else 2)[
        :MOST_PLANES
    ]
    columns = min(COLUMNS, len(shown))
    with styled({"axes.grid": False, "font.size": 7.5, "axes.titlesize": 8}):
        rows = -(-len(shown) // columns)
        figure, axes = panels(rows, columns, width=2.6, height=2.1, sharey=False)
        flat = [axis for row in axes for axis in row]
        for axis in flat[len(shown) :]:
            axis.set_visible(False)
        for plane, axis in zip(shown, flat, strict=False):
            ratio = np.minimum(plane.counts, plane.wanted) / np.maximum(plane.wanted, 1)
            share = np.where(plane.wanted > 0, ratio, np.nan)
            axis.set_facecolor("#c8ccd2")
            _shade(axis, share, 1)
            first, second = (space.variables[v] for v in plane.variables)
            axis.set_title(f"{first.name} × {second.name}")
            for ticks, variable in ((axis.set_yticks, first), (axis.set_xticks, second)):
                if variable.size <= MOST_LABELS:
                    ticks(range(variable.size), variable.labels)
                else:
                    ticks([])
            axis.tick_params(axis="x", rotation=45 if max(map(len, second.labels)) > 8 else 0)
            if share.size <= 64:
                for (i, j), count in np.ndenumerate(plane.counts):
                    text = "×" if not plane.feasible[i, j] else f"{count}"
                    axis.text(j, i, text, ha="center", va="center", fontsize=6.5, color="#20262e")
    return figure


def _shade(axis: Axes, values: NDArray[np.float64], full: float) -> None:
    """Draw values in [0, full] as coloured cells; NaN stays empty."""
    masked = np.ma.masked_invalid(values)
    axis.imshow(masked, cmap=SHADES, vmin=0, vmax=full, aspect="auto", interpolation="nearest")


def pair_matrix(shares: Sequence[PairShare], title: str) -> Figure:
    """Covered share of the feasible pairs of categories of each two variables, in percent.

    Left: pairs in tests. Right: pairs in failures.
    """
    names = list(dict.fromkeys(name for share in shares for name in (share.first, share.second)))
    with styled({"axes.grid": False, "axes.spines.left": False, "axes.spines.bottom": False}):
        figure, axes = panels(1, 2, width=PAGE_INCHES / 2, height=0.4 * len(names) + 1.1)
        for axis, field in zip(axes[0], ("tests", "failures"), strict=True):
            values = np.full((len(names), len(names)), np.nan)
            for share in shares:
                cell = names.index(share.second), names.index(share.first)
                values[cell] = 100 * getattr(share, field) / share.feasible
            shown = values[1:, :-1]
            _shade(axis, shown, 100)
            centred: dict[str, Any] = {
                "ha": "center",
                "va": "center",
                "fontsize": 8.5,
                "color": "#20262e",
            }
            for row, column in np.argwhere(np.isfinite(shown)):
                axis.text(column, row, f"{shown[row, column]:.0f}", **centred)
            labels = [name.replace("_", " ") for name in names]
            ticks = range(len(names) - 1)
            axis.set_xticks(ticks, labels[:-1], rotation=35, ha="right", rotation_mode="anchor")
            axis.set_yticks(ticks, labels[1:])
            axis.tick_params(length=0)
            axis.set_title(f"{title}: pairs in {field} (%)")
    return figure


def growth(shares: Sequence[tuple[int, float]], k: int) -> Figure:
    """Coverage over the number of points. shares: (points, coverage in [0, 1])."""
    with styled():
        figure, axes = panels(1, 1, width=6.5, height=3.2)
        axis = axes[0][0]
        points, covered = zip(*shares, strict=True)
        percent = [100 * share for share in covered]
        marker = "o" if len(shares) <= 40 else None
        axis.plot(points, percent, color=SERIES[0], linewidth=1.8, marker=marker, markersize=3.5)
        axis.axhline(100, color=INK, linewidth=0.7, linestyle="--")
        axis.set(ylim=(0, 105), xlabel="points", ylabel=f"{k}-projection coverage (%)")
        whole_numbers(axis.xaxis)
    return figure
