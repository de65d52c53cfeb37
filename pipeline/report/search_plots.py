"""Figures of the search: adj. TTC and failures test by test, failures, coverage by strategy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.search_results import Measures, StrategyMeasures
from pipeline.artefacts.tables import is_valid
from pipeline.core.names import count_of
from pipeline.core.space import Space, Variable
from pipeline.report.style import (
    INK,
    MODE_COLOURS,
    MODE_NAMES,
    UNASSIGNED,
    legend_below,
    panels,
    series_colours,
    styled,
    whole_numbers,
    wrapped,
)

MARKERS = ("o", "s", "^", "D", "v", "P")
"""One per seed; they repeat."""
DRAWN_AS_SHAPES = 2000
"""With more tests, a panel's points become an image: shapes would make the page large and slow."""


def kpi_scatter(
    tests: pd.DataFrame, strategies: Sequence[str], label: str, threshold_s: float
) -> Figure:
    """`kpi_panels` of one scenario, a panel for each strategy.

    Args:
        tests: Rows of the scenario's campaigns, columns of tests.parquet.
        strategies: Strategies in the order of their panels.
        label: Printed label of the scenario.
        threshold_s: Adj. TTC at or below which a test fails.
    """
    campaigns = {}
    for strategy in strategies:
        campaigns[f"{label} · {strategy}"] = tests[tests["strategy"] == strategy]
    return kpi_panels(campaigns, threshold_s)


def kpi_panels(
    campaigns: Mapping[str, pd.DataFrame], threshold_s: float, columns: int = 3
) -> Figure:
    """Adj. TTC over the position in the campaign, with the mean of each batch (thesis Fig. 6.1).

    Tests that ended in an error are left out.

    Args:
        campaigns: Title of a panel -> its tests, columns of tests.parquet.
        threshold_s: Adj. TTC at or below which a test fails.
        columns: Largest number of panels in a row.
    """
    with styled():
        figure, axes = wrapped(len(campaigns), columns, height=3.1, ylabel="adj. TTC (s)")
        for axis, (title, tests) in zip(axes, campaigns.items(), strict=True):
            chosen = tests[is_valid(tests)]
            _scatter_modes(axis, chosen)
            means = chosen.groupby("batch")[["index", "adj_ttc_s"]].mean()
            line: dict[str, Any] = {"linewidth": 1.4, "label": "batch mean", "zorder": 3}
            axis.plot(means["index"] + 1, means["adj_ttc_s"], color=INK, **line)
            dashed: dict[str, Any] = {"linestyle": "--", "linewidth": 1, "zorder": 2}
            axis.axhline(threshold_s, color=MODE_COLOURS["contact"], **dashed)
            axis.set(title=title, xlabel="test")
            whole_numbers(axis.xaxis)
        axes[0].set_ylim(bottom=-0.04)
        legend_below(figure, axes)
    return figure


def _scatter_modes(axis: Axes, tests: pd.DataFrame) -> None:
    # Passed tests come first, below the failures.
    modes = [*MODE_COLOURS][::-1]
    # Unnecessary braking exists only in scenarios in which the right answer is not to brake.
    if not (tests["failure_mode"] == "false_activation").any():
        modes.remove("false_activation")
    for seed_rank, seed in enumerate(sorted(tests["seed"].unique())):
        for mode in modes:
            rows = tests[(tests["seed"] == seed) & (tests["failure_mode"] == mode)]
            name = MODE_NAMES[mode] if seed_rank == 0 or mode != "none" else None
            size, alpha, order = (14, 0.5, 2) if mode == "none" else (26, 0.95, 4)
            axis.scatter(
                rows["index"] + 1,
                rows["adj_ttc_s"],
                color=MODE_COLOURS[mode],
                marker=MARKERS[seed_rank % len(MARKERS)],
                s=size,
                alpha=alpha,
                linewidths=0,
                label=name,
                zorder=order,
                rasterized=len(tests) > DRAWN_AS_SHAPES,
            )


def theta_curves(measures: Measures, labels: Mapping[str, str]) -> Figure:
    """Θ, failures found after each test (Eq. 4.17): mean over seeds, minimum and maximum."""
    strategies = list(dict.fromkeys(campaign.strategy for campaign in measures.campaigns))
    colours = series_colours(strategies)
    with styled():
        figure, axes = wrapped(len(labels), 4, height=2.8, ylabel="failures found, Θ", sharey=False)
        for axis, (scenario, label) in zip(axes, labels.items(), strict=True):
            for strategy in strategies:
                key = (scenario, strategy)
                curves = [c.theta for c in measures.campaigns if (c.scenario, c.strategy) == key]
                length = min(map(len, curves), default=0)
                if length == 0:
                    continue
                table = np.array([curve[:length] for curve in curves])
                position, colour = np.arange(1, length + 1), colours[strategy]
                band = (table.min(0), table.max(0))
                axis.fill_between(position, *band, color=colour, alpha=0.18, linewidth=0)
                axis.plot(position, table.mean(0), color=colour, linewidth=2, label=strategy)
            highest = max(1.0, axis.get_ylim()[1])
            axis.set(title=label, xlabel="tests", ylim=(0, highest), xlim=(0, None))
            whole_numbers(axis.xaxis, axis.yaxis)
        legend_below(figure, axes)
    return figure


def parallel_coordinates(tests: pd.DataFrame, space: Space, regions: FailureRegions) -> Figure:
    """Every failure of a scenario as a line through its values, coloured by region.

    Thesis Fig. 6.3. tests: rows of the scenario's campaigns.
    """
    failures = tests[tests["failure"]].set_index("test_id")
    groups = {"isolated": regions.isolated}
    groups |= {region.name: region.members for region in regions.regions}
    chosen = {}
    for name, members in groups.items():
        chosen[name] = failures.loc[failures.index.intersection(list(members))]
    title = f"{regions.label}: {count_of(regions.failures, 'failure')}"
    return parallel_lines(chosen, space, title)


def parallel_lines(groups: Mapping[str, pd.DataFrame], space: Space, title: str) -> Figure:
    """Tests as lines through the values of their variables, a colour for each group.

    Axes run from the lowest value of a variable (bottom) to the highest. The first group is grey.

    Args:
        groups: Name -> rows with a column for each variable.
        space: The scenario space.
        title: Title of the figure.
    """
    first, *others = groups
    colours = {first: UNASSIGNED, **series_colours(others)}
    with styled():
        figure, axes = panels(1, 1, width=10.4, height=3.8)
        axis = axes[0][0]
        axis.grid(False)
        for name, rows in groups.items():
            if len(rows) == 0:
                continue
            columns = [_heights(variable, rows[variable.name]) for variable in space.variables]
            heights = np.column_stack(columns)
            style: dict[str, Any] = {"alpha": 0.45 if name == first else 0.85, "linewidth": 1.3}
            style["rasterized"] = len(rows) > DRAWN_AS_SHAPES
            lines = axis.plot(np.arange(len(space)), heights.T, color=colours[name], **style)
            lines[0].set_label(f"{name} ({len(rows)})")
        _vertical_axes(axis, space)
        axis.set_title(title)
        legend_below(figure, [axis])
    return figure


def _heights(variable: Variable, column: pd.Series) -> np.ndarray:
    """Values of one variable as heights in [0, 1]."""
    encoded = np.array([variable.encode(value) for value in column])
    if variable.kind == "categorical":
        return encoded / max(1, variable.size - 1)
    return (encoded - variable.low) / (variable.high - variable.low)


def _vertical_axes(axis: Axes, space: Space) -> None:
    for position, variable in enumerate(space.variables):
        axis.plot([position] * 2, [0, 1], color=INK, linewidth=0.8, alpha=0.6, zorder=0)
        low, high = f"{variable.low:g}", f"{variable.high:g}"
        if variable.values:
            low, high = variable.labels[0], variable.labels[-1]
        for height, text, side in ((-0.01, low, "top"), (1.01, high, "bottom")):
            axis.text(position + 0.04, height, text, ha="left", va=side, fontsize=8)
    titles = []
    for name, unit in space.units.items():
        titles.append(name.replace("_", "\n") + (f"\n({unit})" if unit else ""))
    axis.set_xticks(range(len(space)), titles)
    axis.tick_params(axis="x", length=0, pad=8)
    axis.set(yticks=[], ylim=(-0.16, 1.16), xlim=(-0.4, len(space) - 0.6))
    for spine in axis.spines.values():
        spine.set_visible(False)


def coverage_bars(measures: Measures, labels: Mapping[str, str]) -> Figure:
    """Share of all pairs of categories that a campaign covers (thesis Table 6.6).

    Left: covered by its tests. Right: covered by its failures.
    """
    with styled():
        figure, axes = panels(1, 2, width=4.6, height=3.0, sharey=False)
        for axis, field, title in (
            (axes[0][0], "pair_coverage_tests", "pairs covered by tests"),
            (axes[0][1], "pair_coverage_failures", "pairs covered by failures"),
        ):
            _grouped_bars(axis, measures.strategies, field, labels)
            axis.set(title=title, ylim=(0, None))
            axis.yaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
        legend_below(figure, axes[0])
    return figure


def _grouped_bars(
    axis: Axes, rows: Sequence[StrategyMeasures], field: str, labels: Mapping[str, str]
) -> None:
    strategies = list(dict.fromkeys(row.strategy for row in rows))
    colours = series_colours(strategies)
    width = 0.8 / max(1, len(strategies))
    for rank, strategy in enumerate(strategies):
        of_scenario = {row.scenario: row for row in reversed(rows) if row.strategy == strategy}
        estimates = [getattr(of_scenario[scenario], field) for scenario in labels]
        positions = np.arange(len(estimates)) + (rank - (len(strategies) - 1) / 2) * width
        values = np.array([estimate.value for estimate in estimates])
        low, high = [e.low for e in estimates], [e.high for e in estimates]
        errors = np.abs(np.array([low, high]) - values)
        # With one seed there is no interval, rather than one of width 0.
        bars = errors if errors.any() else None
        axis.bar(
            positions,
            values,
            width * 0.9,
            color=colours[strategy],
            label=strategy,
            yerr=bars,
            ecolor=INK,
            capsize=3,
        )
    axis.set_xticks(range(len(labels)), list(labels.values()))
    axis.grid(False, axis="x")
