"""Figures of the search: adj. TTC and failures test by test, the failures themselves, coverage by strategy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
"""With more tests, a panel's points are one picture: shapes would make the page large and slow."""


def kpi_scatter(
    tests: pd.DataFrame, strategies: Sequence[str], label: str, threshold_s: float
) -> Figure:
    """`kpi_panels` of one scenario: a panel for each strategy. tests: rows of its campaigns, columns of tests.parquet."""
    return kpi_panels(
        {f"{label} · {strategy}": tests[tests["strategy"] == strategy] for strategy in strategies},
        threshold_s,
    )


def kpi_panels(
    campaigns: Mapping[str, pd.DataFrame], threshold_s: float, columns: int = 3
) -> Figure:
    """adj. TTC over the position in the campaign, one panel for each title (thesis Fig. 6.1), with the mean of each batch.

    campaigns: tests by title, columns of tests.parquet. Tests that ended in an error are left out.
    """
    with styled():
        figure, axes = wrapped(len(campaigns), columns, height=3.1, ylabel="adj. TTC (s)")
        for axis, (title, tests) in zip(axes, campaigns.items(), strict=True):
            chosen = tests[is_valid(tests)]
            _scatter_modes(axis, chosen)
            batches = chosen.groupby("batch").agg(
                index=("index", "mean"), adj_ttc_s=("adj_ttc_s", "mean")
            )
            axis.plot(
                batches["index"] + 1,
                batches["adj_ttc_s"],
                color=INK,
                linewidth=1.4,
                label="batch mean",
                zorder=3,
            )
            axis.axhline(
                threshold_s, color=MODE_COLOURS["contact"], linestyle="--", linewidth=1, zorder=2
            )
            axis.set(title=title, xlabel="test")
            whole_numbers(axis.xaxis)
        axes[0].set_ylim(bottom=-0.04)
        legend_below(figure, axes)
    return figure


def _scatter_modes(axis: Axes, tests: pd.DataFrame) -> None:
    # Only scenarios that ask not to brake know unnecessary braking. Passed tests come first, below the failures.
    modes = [
        mode
        for mode in reversed([*MODE_COLOURS])
        if mode != "false_activation" or (tests["failure_mode"] == mode).any()
    ]
    for seed_rank, seed in enumerate(sorted(tests["seed"].unique())):
        for mode in modes:
            rows = tests[(tests["seed"] == seed) & (tests["failure_mode"] == mode)]
            name = MODE_NAMES[mode] if seed_rank == 0 or mode != "none" else None
            axis.scatter(
                rows["index"] + 1,
                rows["adj_ttc_s"],
                color=MODE_COLOURS[mode],
                marker=MARKERS[seed_rank % len(MARKERS)],
                s=14 if mode == "none" else 26,
                alpha=0.5 if mode == "none" else 0.95,
                linewidths=0,
                label=name,
                zorder=2 if mode == "none" else 4,
                rasterized=len(tests) > DRAWN_AS_SHAPES,
            )


def theta_curves(measures: Measures, labels: Mapping[str, str]) -> Figure:
    """Θ, failures found after each test (Eq. 4.17): the mean over seeds in a band from minimum to maximum."""
    strategies = list(dict.fromkeys(campaign.strategy for campaign in measures.campaigns))
    colours = series_colours(strategies)
    with styled():
        figure, axes = wrapped(len(labels), 4, height=2.8, ylabel="failures found, Θ", sharey=False)
        for axis, (scenario, label) in zip(axes, labels.items(), strict=True):
            for strategy in strategies:
                curves = [
                    c.theta
                    for c in measures.campaigns
                    if (c.scenario, c.strategy) == (scenario, strategy)
                ]
                length = min((len(curve) for curve in curves), default=0)
                if length == 0:
                    continue
                table = np.array([curve[:length] for curve in curves])
                position = np.arange(1, length + 1)
                axis.fill_between(
                    position,
                    table.min(0),
                    table.max(0),
                    color=colours[strategy],
                    alpha=0.18,
                    linewidth=0,
                )
                axis.plot(
                    position, table.mean(0), color=colours[strategy], linewidth=2, label=strategy
                )
            axis.set(
                title=label, xlabel="tests", ylim=(0, max(1.0, axis.get_ylim()[1])), xlim=(0, None)
            )
            whole_numbers(axis.xaxis, axis.yaxis)
        legend_below(figure, axes)
    return figure


def parallel_coordinates(tests: pd.DataFrame, space: Space, regions: FailureRegions) -> Figure:
    """Every failure of a scenario as a line through the values of its variables (thesis Fig. 6.3), coloured by region.

    tests: rows of the scenario's campaigns.
    """
    failures = tests[tests["failure"]].set_index("test_id")
    groups = {"isolated": regions.isolated} | {
        region.name: region.members for region in regions.regions
    }
    chosen = {
        name: failures.loc[failures.index.intersection(list(members))]
        for name, members in groups.items()
    }
    return parallel_lines(
        chosen, space, f"{regions.label}: {count_of(regions.failures, 'failure')}"
    )


def parallel_lines(groups: Mapping[str, pd.DataFrame], space: Space, title: str) -> Figure:
    """Tests as lines through the values of their variables, a colour for each group that has any; the first group is grey.

    groups: rows with a column for each variable. Axes run from the lowest value of a variable (bottom) to the highest.
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
            heights = np.column_stack(
                [_heights(variable, rows[variable.name]) for variable in space.variables]
            )
            many, alpha = len(rows) > DRAWN_AS_SHAPES, 0.45 if name == first else 0.85
            lines = axis.plot(
                np.arange(len(space)),
                heights.T,
                color=colours[name],
                alpha=alpha,
                linewidth=1.3,
                rasterized=many,
            )
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
        low, high = (
            (variable.labels[0], variable.labels[-1])
            if variable.values
            else (variable.low, variable.high)
        )
        for height, value, side in ((-0.01, low, "top"), (1.01, high, "bottom")):
            text = value if isinstance(value, str) else f"{value:g}"
            axis.text(position + 0.04, height, text, ha="left", va=side, fontsize=8)
    titles = [
        name.replace("_", "\n") + (f"\n({unit})" if unit else "")
        for name, unit in space.units.items()
    ]
    axis.set_xticks(range(len(space)), titles)
    axis.tick_params(axis="x", length=0, pad=8)
    axis.set(yticks=[], ylim=(-0.16, 1.16), xlim=(-0.4, len(space) - 0.6))
    for spine in axis.spines.values():
        spine.set_visible(False)


def coverage_bars(measures: Measures, labels: Mapping[str, str]) -> Figure:
    """Share of all pairs of categories that the tests (left) and the failures (right) of a campaign cover (thesis Table 6.6)."""
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
        chosen = [
            next(r for r in rows if (r.scenario, r.strategy) == (scenario, strategy))
            for scenario in labels
        ]
        estimates = [getattr(row, field) for row in chosen]
        positions = np.arange(len(chosen)) + (rank - (len(strategies) - 1) / 2) * width
        values = np.array([estimate.value for estimate in estimates])
        errors = np.abs(
            np.array([[e.low for e in estimates], [e.high for e in estimates]]) - values
        )
        bars = (
            errors if errors.any() else None
        )  # With one seed there is no interval, rather than one of width 0.
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
