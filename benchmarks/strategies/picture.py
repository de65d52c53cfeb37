"""The figure: failures against kinds of failures, after 300 and 1,000 tests, one panel for each group of worlds."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd
from contestants import CEILING
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.report.style import INK, legend_below, series_colours, styled, wrapped

BUDGETS = (300, 1000)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def failures_against_kinds(tables: Mapping[tuple[str, int], pd.DataFrame]) -> Figure:
    """tables: standings by group and budget. A line runs from 300 tests (hollow) to 1,000 (filled); bars are intervals over seeds."""
    shown = {
        key: table[table["strategy"] != CEILING]
        for key, table in tables.items()
        if key[1] in BUDGETS
    }
    groups = list(dict.fromkeys(group for group, _ in shown))
    names = list(dict.fromkeys(name for table in shown.values() for name in table["strategy"]))
    colours = series_colours(names)
    with styled():
        figure, axes = wrapped(
            len(groups), min(3, len(groups)), height=3.4, ylabel="kinds of failures", sharey=False
        )
        for axis, group in zip(axes, groups, strict=True):
            for rank, name in enumerate(names):
                points = [
                    table[table["strategy"] == name].assign(budget=n)
                    for (key, n), table in shown.items()
                    if key == group
                ]
                _line(axis, pd.concat(points), name, colours[name], MARKERS[rank % len(MARKERS)])
            axis.set(title=group, xlabel="failures", xlim=(0, None), ylim=(0, None))
        legend_below(figure, axes)
    return figure


def _line(axis: Axes, points: pd.DataFrame, name: str, colour: str, marker: str) -> None:
    axis.plot(points["failures"], points["kinds"], color=colour, linewidth=1, alpha=0.6, zorder=2)
    for row in points.to_dict("records"):
        x, y = (
            [[row[name] - row[f"{name}_low"]], [row[f"{name}_high"] - row[name]]]
            for name in ("failures", "kinds")
        )
        axis.errorbar(
            row["failures"], row["kinds"], xerr=x, yerr=y, color=colour, linewidth=0.8, zorder=1
        )
        filled = row["budget"] == BUDGETS[-1]
        axis.plot(
            row["failures"],
            row["kinds"],
            marker,
            color=colour,
            markerfacecolor=colour if filled else "white",
            markersize=6,
            markeredgecolor=INK if filled else colour,
            markeredgewidth=0.5 if filled else 1.2,
            label=name if filled or len(points) == 1 else None,
            zorder=3,
        )
