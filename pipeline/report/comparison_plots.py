"""Figures of the comparison: failures by version, mode and round, distribution of adj. TTC."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.failure_counts import Modes
from pipeline.artefacts.tables import is_valid
from pipeline.report.style import (
    MODE_COLOURS,
    MODE_NAMES,
    legend_below,
    panels,
    series_colours,
    styled,
)


def comparison_bars(comparison: Comparison) -> Figure:
    """Failure rate of each version on the frozen sequence, stacked by failure mode."""
    with styled():
        figure, axes = panels(1, 1, width=9.4, height=0.5 * len(comparison.versions) + 1.2)
        axis = axes[0][0]
        for position, version in enumerate(comparison.versions):
            tests, left = max(1, version.tests), 0.0
            for mode in Modes.model_fields:
                share = getattr(version.modes, mode) / tests
                name = MODE_NAMES[mode] if position == 0 else None
                axis.barh(position, share, 0.6, left=left, color=MODE_COLOURS[mode], label=name)
                left += share
        names = [version.version for version in comparison.versions]
        axis.set_yticks(range(len(names)), names)
        axis.invert_yaxis()
        axis.grid(False, axis="y")
        axis.xaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
        title = " + ".join(comparison.scenarios.values())
        axis.set(xlabel="share of tests that fail", xlim=(0, None), title=title)
        legend_below(figure, [axis])
    return figure


def kpi_histogram(table: pd.DataFrame, comparison: Comparison, threshold_s: float) -> Figure:
    """Distribution of adj. TTC (thesis Fig. 7.4, 7.5), one row of panels per held-out scenario.

    There is one column for base and one for each group of the last round, mean over its seeds. The
    first bin contains the failures, except for unnecessary braking, which fails at any adj. TTC.

    Args:
        table: Rows of comparison.parquet.
        comparison: The compared versions.
        threshold_s: Adj. TTC at or below which a test fails; the width of a bin.
    """
    base, *others = comparison.groups
    groups = [base, *(group for group in others if group.round == others[-1].round)]
    table = table[is_valid(table)]
    top = max(threshold_s * 2, float(table["adj_ttc_s"].max()) if len(table) else 0.0)
    edges = np.arange(0, top + threshold_s, threshold_s)
    with styled():
        labels = comparison.scenarios
        height = 2.5 if len(labels) == 1 else 1.8
        figure, axes = panels(len(labels), len(groups), width=9.4 / len(groups), height=height)
        for line, (scenario, label) in zip(axes, labels.items(), strict=True):
            for axis, group in zip(line, groups, strict=True):
                of_group = table["version"].isin(group.versions)
                rows = table[of_group & (table["scenario"] == scenario)]
                failed, adjusted_s = rows["failure"], rows["adj_ttc_s"]
                parts = [adjusted_s[failed], adjusted_s[~failed]]
                weights = [np.full(len(part), 1 / len(group.versions)) for part in parts]
                colours = [MODE_COLOURS["contact"], MODE_COLOURS["none"]]
                axis.hist(
                    parts,
                    list(edges),
                    weights=weights,
                    stacked=True,
                    color=colours,
                    label=["failure", "no failure"],
                    rwidth=0.92,
                )
                axis.set(xlim=(0, None))
                axis.grid(False, axis="x")
            line[0].set_ylabel(f"{label}, tests")
        for axis, group in zip(axes[0], groups, strict=True):
            axis.set_title(group.group)
        for axis in axes[-1]:
            axis.set_xlabel("adj. TTC (s)")
        legend_below(figure, axes[0])
    return figure


def failures_by_round(comparison: Comparison) -> Figure:
    """Failures on the frozen sequence after each round, by kind of version.

    The kinds are offset sideways so that their intervals do not overlap.
    """
    base, *retrained = comparison.groups
    kinds = list(dict.fromkeys(group.group.partition("-")[0] for group in retrained))
    colours = series_colours(kinds)
    with styled():
        figure, axes = panels(1, 1, width=6.4, height=3.2)
        axis = axes[0][0]
        for rank, kind in enumerate(kinds):
            line = [base, *(group for group in retrained if group.group.partition("-")[0] == kind)]
            values = np.array([group.failures.value for group in line])
            low = [group.failures.low for group in line]
            high = [group.failures.high for group in line]
            errors = np.abs(np.array([low, high]) - values)
            rounds = [group.round + 0.06 * (rank - (len(kinds) - 1) / 2) for group in line]
            style: dict[str, Any] = {"marker": "o", "linewidth": 2, "capsize": 3}
            axis.errorbar(rounds, values, errors, color=colours[kind], label=kind, **style)
        axis.set(xlabel="round", ylabel="failures on held-out tests", ylim=(0, None))
        axis.set_xticks(range(max(group.round for group in comparison.groups) + 1))
        legend_below(figure, [axis])
    return figure
