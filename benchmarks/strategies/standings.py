"""How strategies compare over the seeds and worlds of a group, as tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from contestants import CEILING
from scores import BUDGETS, MEASURES
from worlds import GROUPS, WorldName

from pipeline.core.measures import baseline_cost, f_measure
from pipeline.core.space import Floats, Ints
from pipeline.core.statistics import bootstrap_mean, bootstrap_ratio, censored_mean, vargha_delaney

CONFIDENCE = 0.95
COMPARED = ("failures", "kinds", "gamma_f")
"""Measures with a ratio to the reference."""
MANY = 10
"""F is also measured for this many failures."""


@dataclass(frozen=True)
class Block:
    """The campaigns of one group after one budget: a column `strategy`, `world`, `seed` and the measures."""

    group: str
    budget: int
    rows: pd.DataFrame

    def values(self, strategy: str, measure: str) -> pd.DataFrame:
        """Seeds by worlds; NaN where a campaign is missing."""
        return self.rows[self.rows["strategy"] == strategy].pivot(
            index="seed", columns="world", values=measure
        )

    @property
    def strategies(self) -> list[str]:
        return list(self.rows["strategy"].unique())


def blocks(rows: Sequence[dict[str, Any]]) -> Iterator[Block]:
    """The rows of campaigns by group and budget, in the order of `GROUPS`."""
    table = pd.DataFrame(rows)
    table["group"] = [WorldName.parse(world).group for world in table["world"]]
    for group in GROUPS:
        for budget in BUDGETS:
            chosen = table[(table["group"] == group) & (table["tests"] >= budget)]
            if len(chosen):
                # Of runs of several lengths, the longest counts: its beginning equals the shorter ones.
                chosen = chosen.sort_values("tests", kind="stable").drop_duplicates(
                    ["world", "strategy", "seed"], keep="last"
                )
                yield Block(
                    group,
                    budget,
                    chosen.rename(columns={f"{name}_{budget}": name for name in MEASURES}),
                )


def standings(block: Block, reference: str) -> pd.DataFrame:
    """A row for each strategy: means over seeds and worlds, intervals over seeds, ratios to the reference strategy.

    A seed counts where every world of the group has it. Columns `<measure>`, `<measure>_low`, `_high`, and for `COMPARED` also
    `<measure>_ratio` with the same ends; `a12` is the mean over worlds. `f`, `f_many` and `cost` are censored means over campaigns.
    """
    return pd.DataFrame([_standing(block, strategy, reference) for strategy in block.strategies])


def _standing(block: Block, strategy: str, reference: str) -> dict[str, Any]:
    own = block.rows[block.rows["strategy"] == strategy]
    row: dict[str, Any] = {
        "strategy": strategy,
        "campaigns": len(own),
        "errors": int(own["errors"].sum()),
    }
    row["ms"] = (
        1000 * float(own["cpu_s"].sum() / own["tests"].sum()) if strategy != CEILING else np.nan
    )
    for measure in MEASURES:
        means = block.values(strategy, measure).dropna().mean(axis=1)
        row |= {"seeds": len(means), measure: float(means.mean())}
        if len(means):
            row |= _interval(means.to_numpy(float), measure)
        if len(means) and measure in COMPARED:
            row |= _ratio(block, strategy, reference, measure)
    row["a12"] = _a12(block, strategy, reference)
    row["of_ceiling"] = _of_ceiling(block, strategy)
    for name, n in (("f", 1), ("f_many", MANY)):
        row |= _censored(
            name,
            [
                _reached([at for at in failed if at <= block.budget], n, block.budget)
                for failed in own["failed_at"]
            ],
        )
    return row | _censored("cost", _costs(block, strategy, reference))


def _interval(means: Floats, measure: str) -> dict[str, float]:
    low, high = bootstrap_mean(means, np.random.default_rng(0), CONFIDENCE)
    return {f"{measure}_low": low, f"{measure}_high": high}


def _ratio(block: Block, strategy: str, reference: str, measure: str) -> dict[str, float]:
    """Ratio of the means over the worlds and seeds that both have."""
    both = pd.concat(
        {name: block.values(name, measure).stack() for name in {strategy, reference}}, axis=1
    ).dropna()
    if reference not in block.strategies or not len(both):
        return {}
    seeds = both.groupby("seed").mean()
    value, other = seeds[strategy].to_numpy(float), seeds[reference].to_numpy(float)
    low, high = bootstrap_ratio(value, other, np.random.default_rng(0), CONFIDENCE)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            f"{measure}_ratio": float(value.mean() / other.mean()),
            f"{measure}_ratio_low": low,
            f"{measure}_ratio_high": high,
        }


def _a12(block: Block, strategy: str, reference: str) -> float:
    """The probability that the strategy finds more failures than the reference, the mean over worlds."""
    own, other = block.values(strategy, "failures"), block.values(reference, "failures")
    shared = [world for world in own if world in other]
    return (
        float(
            np.mean(
                [vargha_delaney(own[world].dropna(), other[world].dropna()) for world in shared]
            )
        )
        if shared
        else np.nan
    )


def _of_ceiling(block: Block, strategy: str) -> float:
    """Pair coverage of failures as a share of what the ceiling reaches in the same worlds, the mean over campaigns."""
    own, most = block.values(strategy, "gamma_f"), block.values(CEILING, "gamma_f")
    shares = (own / most).stack().dropna() if len(most) else pd.Series(dtype=float)
    return float(shares.mean()) if len(shares) else np.nan


def _reached(failed_at: Sequence[int], n: int, budget: int) -> tuple[int, bool]:
    """Tests until the n-th failure, and whether it was reached; if not, the budget."""
    needed = f_measure(_theta(failed_at, budget), n)
    return needed or budget, needed is not None


def _costs(block: Block, strategy: str, reference: str) -> list[tuple[float, bool]]:
    """For each campaign with a reference of the same world and seed: 1 - C_n, and whether the n failures were reached."""
    if strategy == reference:
        return []
    others = {
        (row.world, row.seed): row.failed_at
        for row in block.rows[block.rows["strategy"] == reference].itertuples()
    }
    costs = []
    for row in block.rows[block.rows["strategy"] == strategy].itertuples():
        if (row.world, row.seed) in others:
            n, needed = baseline_cost(_theta(others[row.world, row.seed], block.budget))
            at, reached = _reached(row.failed_at, n, block.budget)
            costs.append((at / needed, reached))
    return costs


def _theta(failed_at: Sequence[int], budget: int) -> Ints:
    """The failure sequence of the first `budget` tests."""
    return np.searchsorted(
        np.asarray(failed_at, dtype=np.int64), np.arange(1, budget + 1), side="right"
    ).astype(np.int64)


def _censored(name: str, values: Sequence[tuple[float, bool]]) -> dict[str, float]:
    """The censored mean with its interval; a lower bound if `<name>_censored` is the number of campaigns."""
    if not values:
        return {name: np.nan, f"{name}_censored": 0, f"{name}_count": 0}
    mean = censored_mean(
        [value for value, _ in values], [reached for _, reached in values], CONFIDENCE
    )
    ends = {f"{name}_low": mean.low, f"{name}_high": mean.high}
    return {
        name: mean.value,
        **ends,
        f"{name}_censored": mean.censored,
        f"{name}_count": len(values),
    }


def markdown(block: Block, table: pd.DataFrame, reference: str) -> str:
    """A heading and a table, best pair coverage of failures last."""
    heading = [
        "strategy",
        "failures",
        f"× {reference}",
        "A12",
        "kinds",
        f"× {reference}",
        "γ_t, %",
        "γ_f, %",
        f"× {reference}",
    ]
    heading += ["of ceiling", "Θ area, %", "regions", "F", f"F_{MANY}", "C_n", "ms a test"]
    lines = [f"| {' | '.join(heading)} |", "|---" * len(heading) + "|"]
    for row in table.sort_values("gamma_f", kind="stable").to_dict("records"):
        cells = [
            row["strategy"],
            _spread(row, "failures", 0),
            _spread(row, "failures_ratio", 2),
            _number(row["a12"], 2),
            _spread(row, "kinds", 0),
            _spread(row, "kinds_ratio", 2),
            _spread(row, "gamma_t", 0, 100),
            _spread(row, "gamma_f", 1, 100),
            _spread(row, "gamma_f_ratio", 2),
            _percent(row["of_ceiling"], 0),
            _spread(row, "area", 0, 100),
            _spread(row, "regions", 1),
            _tests(row, "f"),
            _tests(row, "f_many"),
            _saved(row),
            _number(row["ms"], 1),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    fewest, most = table["seeds"].min(), table["seeds"].max()
    worlds = ", ".join(sorted(block.rows["world"].unique()))
    lead = f"### {block.group}, {block.budget} tests\n\nWorlds: {worlds}. Seeds: {most if fewest == most else f'{fewest} to {most}'}."
    if errors := int(table["errors"].sum()):
        lead += f" {errors} tests of all campaigns ended in an error."
    return "\n".join([lead, "", *lines, ""])


def _spread(row: dict[str, Any], name: str, digits: int, scale: float = 1) -> str:
    """A number with its interval."""
    if np.isnan(row.get(name, np.nan)):
        return "–"
    value, low, high = (
        _number(scale * row[key], digits) for key in (name, f"{name}_low", f"{name}_high")
    )
    return f"{value} ({low}–{high})"


def _tests(row: dict[str, Any], name: str) -> str:
    """F or F_n with its interval; a lower bound without one if no campaign came so far."""
    return (
        f"≥ {_number(row[name], 0)}"
        if row[f"{name}_censored"] == row[f"{name}_count"]
        else _spread(row, name, 0)
    )


def _saved(row: dict[str, Any]) -> str:
    """C_n with its interval; an upper bound without one if no campaign found as many failures as random testing."""
    if row["cost_count"] and row["cost_censored"] == row["cost_count"]:
        return f"≤ {_number(1 - row['cost'], 2)}"
    ends = {
        "saved": 1 - row["cost"],
        "saved_low": 1 - row.get("cost_high", np.nan),
        "saved_high": 1 - row.get("cost_low", np.nan),
    }
    return _spread(ends, "saved", 2)


def _number(value: float, digits: int) -> str:
    # A sum's last bits depend on its order; without them, a mean of 20.5 is rounded alike wherever it was added up.
    return "–" if np.isnan(value) else "∞" if np.isinf(value) else f"{round(value, 9):.{digits}f}"


def _percent(value: float, digits: int) -> str:
    return "–" if np.isnan(value) else f"{100 * value:.{digits}f} %"
