"""VerifAI's Bayesian sampler, too slow for the whole benchmark, against the first tests of other campaigns in the same worlds and seeds.

And why it finds many kinds: against forests with more slots for new kinds, in the development worlds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd
from duels import SYMBOLS, Duel, kinds, ratio

BAYESIAN, REFERENCE = "verifai-bayesian", "random"
STRATEGIES = (REFERENCE, "verifai-ce", "verifai-mab", BAYESIAN, "forest")
BUDGET, LATER = 120, 300


def markdown(rows: Sequence[dict[str, Any]], published: Sequence[dict[str, Any]]) -> str:
    """Means over worlds and seeds, a row for each strategy and kind of worlds. rows: of the sampler. published: of the others."""
    played = {(row["world"], row["seed"]) for row in rows}
    paired = [*rows, *(row for row in published if (row["world"], row["seed"]) in played)]
    lines = [
        "| worlds | strategy | campaigns |"
        + "".join(f" {symbol} | × {REFERENCE} |" for symbol in SYMBOLS.values())
    ]
    lines += ["|---" * (3 + 2 * len(SYMBOLS)) + "|"]
    for (kind, _), group in kinds(paired, [BUDGET]).items():
        for strategy in STRATEGIES:
            own = pd.concat([block.rows[block.rows["strategy"] == strategy] for block in group])
            cells = [
                f"{_mean(own, name)} | {ratio(group, Duel(name, strategy, REFERENCE)) or '–'}"
                for name in SYMBOLS
            ]
            lines.append(f"| {kind} | {strategy} | {len(own)} | {' | '.join(cells)} |")
    spent_ms = 1000 * sum(row["cpu_s"] for row in rows) / sum(row["tests"] for row in rows)
    return "\n".join(
        [
            f"`{BAYESIAN}` itself takes {spent_ms:.0f} CPU-ms a test. After {BUDGET} tests:",
            "",
            *lines,
        ]
    )


def of_kinds(rows: Sequence[dict[str, Any]], budget: int) -> str:
    """Means over the campaigns of each strategy: whether new kinds are bought with failures."""
    lines = [
        "| strategy | campaigns | failures | kinds | kinds a failure | γ_f |",
        "|---|---|---|---|---|---|",
    ]
    for strategy, own in pd.DataFrame(rows).groupby("strategy", sort=False):
        failures, kinds, pairs = (own[f"{measure}_{budget}"].mean() for measure in SYMBOLS)
        lines.append(
            f"| {strategy} | {len(own)} | {failures:.1f} | {kinds:.1f} | {kinds / failures:.2f} | {100 * pairs:.1f} % |"
        )
    return "\n".join(lines)


def _mean(rows: pd.DataFrame, measure: str) -> str:
    mean = float(rows[measure].mean())
    return f"{100 * mean:.1f} %" if measure == "gamma_f" else f"{mean:.1f}"
