"""Figures of coverage: a heat map for each plane of two conditions (Cheng et al., Table 1), and coverage over points (Figure 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from pipeline.analysis.pair_shares import PairShare
from pipeline.core.coverage.projection import Plane
from pipeline.core.space import Space
from pipeline.report.style import INK, PAGE_INCHES, SERIES, panels, styled, whole_numbers

COLUMNS = 5
MOST_PLANES = 60
MOST_LABELS = 16
SHADES = LinearSegmentedColormap.from_list("coverage", ["#e9927f", "#f6e3ac", "#b5dcc0"])


def heat_maps(planes: Sequence[Plane], space: Space) -> Figure:
    """Coverage of each cell of each plane of two conditions, least covered planes first; grey: no feasible point, or none required."""
    shown = sorted(planes, key=lambda plane: plane.coverage.ratio if plane.coverage else 2)[
        :MOST_PLANES
    ]
    columns = min(COLUMNS, len(shown))
    with styled({"axes.grid": False, "font.size": 7.5, "axes.titlesize": 8}):
        figure, axes = panels(
            -(-len(shown) // columns), columns, width=2.6, height=2.1, sharey=False
        )
        for axis in (axis for row in axes for axis in row):
            axis.set_visible(False)
        for plane, axis in zip(shown, (axis for row in axes for axis in row), strict=False):
            axis.set_visible(True)
            share = np.where(
                plane.wanted > 0,
                np.minimum(plane.counts, plane.wanted) / np.maximum(plane.wanted, 1),
                np.nan,
            )
            axis.set_facecolor("#c8ccd2")
            axis.imshow(
                np.ma.masked_invalid(share),
                cmap=SHADES,
                vmin=0,
                vmax=1,
                aspect="auto",
                interpolation="nearest",
            )
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


def pair_matrix(shares: Sequence[PairShare], title: str) -> Figure:
    """For each two variables, the share of their feasible pairs of categories that tests (left) and failures (right) show, in percent."""
    names = list(dict.fromkeys(name for share in shares for name in (share.first, share.second)))
    with styled({"axes.grid": False, "axes.spines.left": False, "axes.spines.bottom": False}):
        figure, axes = panels(1, 2, width=PAGE_INCHES / 2, height=0.4 * len(names) + 1.1)
        for axis, field in zip(axes[0], ("tests", "failures"), strict=True):
            values = np.full((len(names), len(names)), np.nan)
            for share in shares:
                values[names.index(share.second), names.index(share.first)] = (
                    100 * getattr(share, field) / share.feasible
                )
            shown = values[1:, :-1]
            axis.imshow(
                np.ma.masked_invalid(shown),
                cmap=SHADES,
                vmin=0,
                vmax=100,
                aspect="auto",
                interpolation="nearest",
            )
            for row, column in np.argwhere(np.isfinite(shown)):
                axis.text(
                    column,
                    row,
                    f"{shown[row, column]:.0f}",
                    ha="center",
                    va="center",
                    fontsize=8.5,
                    color="#20262e",
                )
            labels = [name.replace("_", " ") for name in names]
            axis.set_xticks(
                range(len(names) - 1), labels[:-1], rotation=35, ha="right", rotation_mode="anchor"
            )
            axis.set_yticks(range(len(names) - 1), labels[1:])
            axis.tick_params(length=0)
            axis.set_title(f"{title}: pairs in {field} (%)")
    return figure


def growth(shares: Sequence[tuple[int, float]], k: int) -> Figure:
    """Coverage over the number of points. shares: (points, coverage in [0, 1])."""
    with styled():
        figure, axes = panels(1, 1, width=6.5, height=3.2)
        axis = axes[0][0]
        points, covered = zip(*shares, strict=True)
        axis.plot(
            points,
            [100 * share for share in covered],
            color=SERIES[0],
            linewidth=1.8,
            marker="o" if len(shares) <= 40 else None,
            markersize=3.5,
        )
        axis.axhline(100, color=INK, linewidth=0.7, linestyle="--")
        axis.set(ylim=(0, 105), xlabel="points", ylabel=f"{k}-projection coverage (%)")
        whole_numbers(axis.xaxis)
    return figure
