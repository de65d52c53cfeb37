"""The report's figures. Each function takes artefacts that were read and returns a matplotlib figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.results import FailureRegions, Measures, StrategyMeasures
from pipeline.core.lineage import Version
from pipeline.core.space import Space, Variable
from pipeline.report.border import Case
from pipeline.report.style import INK, MODE_COLOURS, MODE_NAMES, UNASSIGNED, panels, series_colours, styled, wrapped

KEPT, REJECTED = "#2a9d78", "#c9372c"
LABELLED = 5
"""The most bars side by side that still leave room for a number each."""
FEWEST = 10
"""A bin of a reliability diagram with fewer detections shows chance, not reliability; it is left out."""
MARKERS = ("o", "s", "^", "D", "v", "P")


def kpi_scatter(tests: pd.DataFrame, strategies: Sequence[str], label: str, threshold_s: float) -> Figure:
    """adj. TTC over the position in the campaign, one panel a strategy (thesis Fig. 6.1), with the mean of each batch.

    tests: rows of one scenario's campaigns, columns of tests.parquet. Tests whose simulation broke are left out.
    """
    tests = tests[tests["status"] == "ok"]
    with styled():
        figure, axes = wrapped(len(strategies), 3, height=3.1, ylabel="adj. TTC (s)")
        for axis, strategy in zip(axes, strategies, strict=True):
            chosen = tests[tests["strategy"] == strategy]
            _scatter_modes(axis, chosen)
            batches = chosen.groupby("batch").agg(index=("index", "mean"), adj_ttc_s=("adj_ttc_s", "mean"))
            axis.plot(batches["index"] + 1, batches["adj_ttc_s"], color=INK, linewidth=1.4, label="mean of batch", zorder=3)
            axis.axhline(threshold_s, color=MODE_COLOURS["contact"], linestyle="--", linewidth=1, zorder=2)
            axis.set(title=f"{label} · {strategy}", xlabel="position in the campaign (tests)")
        axes[0].set_ylim(bottom=-0.04)
        _legend_below(figure, axes)
    return figure


def _scatter_modes(axis: Axes, tests: pd.DataFrame) -> None:
    for seed_rank, seed in enumerate(sorted(tests["seed"].unique())):
        for mode in ("none", "false_positives", "late", "contact"):
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
            )


def _legend_below(figure: Figure, axes: Sequence[Axes]) -> None:
    """One legend for all panels, each name once."""
    entries: dict[str, Artist] = {}
    for axis in axes:
        for handle, name in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(name, handle)
    if entries:
        legend = figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=min(5, len(entries)))
        for shown in legend.legend_handles:
            if shown is not None:
                shown.set_alpha(1)


def theta_curves(measures: Measures, labels: Mapping[str, str]) -> Figure:
    """Θ, failures found after each test (Eq. 4.17): the mean over seeds, in a band from the least to the most."""
    strategies = list(dict.fromkeys(campaign.strategy for campaign in measures.campaigns))
    colours = series_colours(strategies)
    with styled():
        figure, axes = wrapped(len(labels), 4, height=2.8, ylabel="failures found, Θ", sharey=False)
        for axis, (scenario, label) in zip(axes, labels.items(), strict=True):
            for strategy in strategies:
                curves = [c.theta for c in measures.campaigns if (c.scenario, c.strategy) == (scenario, strategy)]
                length = min((len(curve) for curve in curves), default=0)
                if length == 0:
                    continue
                table = np.array([curve[:length] for curve in curves])
                position = np.arange(1, length + 1)
                axis.fill_between(position, table.min(0), table.max(0), color=colours[strategy], alpha=0.18, linewidth=0)
                axis.plot(position, table.mean(0), color=colours[strategy], linewidth=2, label=strategy)
            axis.set(title=label, xlabel="tests executed", ylim=(0, None), xlim=(0, None))
        _legend_below(figure, axes)
    return figure


def parallel_coordinates(tests: pd.DataFrame, space: Space, regions: FailureRegions) -> Figure:
    """Every failure of a scenario as one line through its variables' values (thesis Fig. 6.3), coloured by region.

    tests: rows of the scenario's campaigns. Axes run from a variable's lowest value (below) to its highest.
    """
    failures = tests[tests["failure"]].set_index("test_id")
    names = [region.name for region in regions.regions]
    colours = series_colours(names)
    groups = [("in no region", UNASSIGNED, regions.unassigned)]
    groups += [(region.name, colours[region.name], region.members) for region in regions.regions]
    with styled():
        figure, axes = panels(1, 1, width=10.4, height=3.8)
        axis = axes[0][0]
        axis.grid(False)
        for name, colour, members in groups:
            rows = failures.loc[failures.index.intersection(list(members))]
            if len(rows) == 0:
                continue
            heights = np.column_stack([_heights(variable, rows[variable.name]) for variable in space.variables])
            alpha = float(np.clip(6 / len(rows), 0.3, 0.9))
            lines = axis.plot(np.arange(len(space)), heights.T, color=colour, alpha=alpha, linewidth=1.3)
            lines[0].set_label(f"{name} ({len(rows)})")
        _vertical_axes(axis, space)
        axis.set_title(f"{regions.label}: {len(failures)} failures")
        _legend_below(figure, [axis])
    return figure


def _heights(variable: Variable, column: pd.Series) -> np.ndarray:
    """Values of one variable as heights in [0, 1]."""
    encoded = np.array([variable.encode(value) for value in column])
    if variable.kind == "categorical":
        return encoded / max(1, variable.size - 1)
    return (encoded - variable.low) / (variable.high - variable.low)


def _vertical_axes(axis: Axes, space: Space) -> None:
    for position, variable in enumerate(space.variables):
        axis.axvline(position, color=INK, linewidth=0.8, alpha=0.6, zorder=0)
        low, high = (variable.labels[0], variable.labels[-1]) if variable.values else (variable.low, variable.high)
        for height, value, side in ((-0.04, low, "top"), (1.04, high, "bottom")):
            text = value if isinstance(value, str) else f"{value:g}"
            axis.text(position + 0.04, height, text, ha="left", va=side, fontsize=8)
    titles = [name.replace("_", "\n") + (f"\n({unit})" if unit else "") for name, unit in _titles(space)]
    axis.set_xticks(range(len(space)), titles)
    axis.tick_params(axis="x", length=0, pad=8)
    axis.set(yticks=[], ylim=(-0.16, 1.16), xlim=(-0.4, len(space) - 0.6))
    for spine in axis.spines.values():
        spine.set_visible(False)


def _titles(space: Space) -> list[tuple[str, str]]:
    return [(variable.name, variable.unit) for variable in space.variables]


def coverage_bars(measures: Measures, labels: Mapping[str, str]) -> Figure:
    """Share of all pairs of categories that the tests (left) and the failures (right) of a campaign cover (thesis Table 6.6)."""
    with styled():
        figure, axes = panels(1, 2, width=4.6, height=3.0, sharey=False)
        for axis, field, title in (
            (axes[0][0], "pair_coverage_tests", "pairs covered by all tests"),
            (axes[0][1], "pair_coverage_failures", "pairs covered by failures"),
        ):
            _grouped_bars(axis, measures.strategies, field, labels)
            axis.set(title=title, ylim=(0, None))
            axis.yaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
        _legend_below(figure, axes[0])
    return figure


def _grouped_bars(axis: Axes, rows: Sequence[StrategyMeasures], field: str, labels: Mapping[str, str]) -> None:
    strategies = list(dict.fromkeys(row.strategy for row in rows))
    colours = series_colours(strategies)
    width = 0.8 / max(1, len(strategies))
    for rank, strategy in enumerate(strategies):
        chosen = [next(r for r in rows if (r.scenario, r.strategy) == (scenario, strategy)) for scenario in labels]
        estimates = [getattr(row, field) for row in chosen]
        positions = np.arange(len(chosen)) + (rank - (len(strategies) - 1) / 2) * width
        values = np.array([estimate.value for estimate in estimates])
        errors = np.abs(np.array([[e.low for e in estimates], [e.high for e in estimates]]) - values)
        bars = errors if errors.any() else None  # One seed has no spread to show, which is not the same as none.
        axis.bar(positions, values, width * 0.9, color=colours[strategy], label=strategy, yerr=bars, ecolor=INK, capsize=3)
    axis.set_xticks(range(len(labels)), list(labels.values()))
    axis.grid(False, axis="x")


def comparison_bars(comparison: Comparison) -> Figure:
    """Failure rate of each version on the frozen sequence, stacked by failure mode, with the Wilson interval of the total."""
    with styled():
        figure, axes = panels(1, 1, width=9.4, height=0.5 * len(comparison.versions) + 1.2)
        axis = axes[0][0]
        for position, version in enumerate(comparison.versions):
            tests, left = max(1, version.tests), 0.0
            for mode in ("contact", "late", "false_positives"):
                share = getattr(version.modes, mode) / tests
                name = MODE_NAMES[mode] if position == 0 else None
                axis.barh(position, share, 0.6, left=left, color=MODE_COLOURS[mode], label=name)
                left += share
            rate = version.rate
            axis.plot([rate.low, rate.high], [position, position], color=INK, linewidth=1.6, marker="|", markersize=9)
        axis.set_yticks(range(len(comparison.versions)), [version.version for version in comparison.versions])
        axis.invert_yaxis()
        axis.grid(False, axis="y")
        axis.xaxis.set_major_formatter(lambda value, _: f"{100 * value:g} %")
        axis.set(xlabel="tests that fail", xlim=(0, None), title=" + ".join(comparison.scenarios.values()))
        _legend_below(figure, [axis])
    return figure


def kpi_histogram(table: pd.DataFrame, comparison: Comparison, threshold_s: float) -> Figure:
    """Distribution of adj. TTC on each held-out scenario (thesis Fig. 7.4, 7.5), a row of panels each; the first bin holds the failures.

    A column for the base and for each group of the last round, means over its seeds. table: rows of comparison.parquet.
    """
    base, *others = comparison.groups
    groups = [base, *(group for group in others if group.round == others[-1].round)]
    table = table[table["status"] == "ok"]
    top = max(threshold_s * 2, float(table["adj_ttc_s"].max()) if len(table) else 0.0)
    edges = np.arange(0, top + threshold_s, threshold_s)
    with styled():
        labels = comparison.scenarios
        figure, axes = panels(len(labels), len(groups), width=9.4 / len(groups), height=2.5 if len(labels) == 1 else 1.8)
        for line, (scenario, label) in zip(axes, labels.items(), strict=True):
            for axis, group in zip(line, groups, strict=True):
                rows = table[table["version"].isin(group.versions) & (table["scenario"] == scenario)]
                parts = [rows.loc[rows["failure"], "adj_ttc_s"], rows.loc[~rows["failure"], "adj_ttc_s"]]
                weights = [np.full(len(part), 1 / len(group.versions)) for part in parts]
                colours = [MODE_COLOURS["contact"], MODE_COLOURS["none"]]
                axis.hist(parts, list(edges), weights=weights, stacked=True, color=colours, label=["failure", "no failure"], rwidth=0.92)
                axis.set(xlim=(0, None))
                axis.grid(False, axis="x")
            line[0].set_ylabel(f"{label}, tests")
        for axis, group in zip(axes[0], groups, strict=True):
            axis.set_title(group.group)
        for axis in axes[-1]:
            axis.set_xlabel("adj. TTC (s)")
        _legend_below(figure, axes[0])
    return figure


def failures_by_round(comparison: Comparison) -> Figure:
    """Failures on the frozen sequence after each round of retraining, by kind of version, side by side so that the bars show."""
    base, *retrained = comparison.groups
    kinds = list(dict.fromkeys(group.group.partition("-")[0] for group in retrained))
    colours = series_colours(kinds)
    with styled():
        figure, axes = panels(1, 1, width=6.4, height=3.2)
        axis = axes[0][0]
        for rank, kind in enumerate(kinds):
            line = [base, *(group for group in retrained if group.group.partition("-")[0] == kind)]
            values = np.array([group.failures.value for group in line])
            errors = np.abs(np.array([[g.failures.low for g in line], [g.failures.high for g in line]]) - values)
            rounds = [group.round + 0.06 * (rank - (len(kinds) - 1) / 2) for group in line]
            axis.errorbar(rounds, values, errors, color=colours[kind], marker="o", linewidth=2, capsize=3, label=kind)
        axis.set(xlabel="rounds of search, filter and retraining", ylabel="held-out tests that fail", ylim=(0, None))
        axis.set_xticks(range(max(group.round for group in comparison.groups) + 1))
        _legend_below(figure, [axis])
    return figure


def border_sheet(cases: Sequence[Case], columns: int = 8) -> Figure:
    """Crops of frames at the filter's border, framed green where they were kept and red where rejected."""
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
            axis.set_title(f"{case.visible_pixels} px, {case.contrast:.0f} grey", fontsize=7.5, fontweight="normal", loc="center")
    return figure


def reliability_diagrams(cards: Sequence[ModelCard]) -> Figure:
    """Share of right detections over their score: the first version before and after calibration, and every version calibrated.

    Versions that differ by their seed alone have one colour.
    """
    groups = [Version.named(card.version).group for card in cards]
    colours = series_colours(list(dict.fromkeys(groups)))
    with styled():
        figure, axes = panels(1, 2, width=4.0, height=3.4)
        shown: list[tuple[Axes, ModelCard, str, str, str]] = [
            (axes[0][0], cards[0], groups[0], name, name) for name in cards[0].reliability
        ]
        labels = [group if group not in groups[:rank] else "" for rank, group in enumerate(groups)]
        shown += [(axes[0][1], card, group, "calibrated", label) for card, group, label in zip(cards, groups, labels, strict=True)]
        for axis, card, group, name, label in shown:
            bins = np.array([one for one in card.reliability.get(name, ()) if one[2] >= FEWEST]).reshape(-1, 3)
            scores, right, counts = bins.T
            colour, style = (UNASSIGNED, "--") if name == "uncalibrated" else (colours[group], "-")
            axis.plot(scores, right, color=colour, linestyle=style, linewidth=1.4, label=label)
            axis.scatter(scores, right, s=6 + 60 * counts / counts.max(initial=1), color=colour, zorder=3)
        for axis, title in zip(axes[0], (f"{cards[0].version}, before and after", "all versions"), strict=True):
            axis.plot([0, 1], [0, 1], color=INK, linewidth=0.8, zorder=1)
            axis.set(title=title, xlabel="confidence", xlim=(0, 1), ylim=(0, 1))
            axis.legend(loc="upper left", fontsize=8)
        axes[0][0].set_ylabel("share of right detections")
    return figure


def detection_bars(metrics: Mapping[str, Mapping[str, float]], names: Mapping[str, str]) -> Figure:
    """Detection metrics in [0, 1] of each version on the validation images.

    metrics: version -> metric -> value. names: metric -> its printed name, in the order to draw. Versions that differ by their seed
    alone have one colour.
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
            bars = axis.bar(positions, heights, width * 0.9, color=colours[groups[version]], label=groups[version])
            if len(metrics) <= LABELLED:
                axis.bar_label(bars, fmt="%.2f", fontsize=7, padding=1)
        axis.set_xticks(range(len(names)), list(names.values()))
        axis.set_ylim(0, 1.08)
        axis.grid(False, axis="x")
        _legend_below(figure, [axis])
    return figure
