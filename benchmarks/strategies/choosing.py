"""The table from which a person chooses a strategy: what each finds in 300 tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd
from contestants import CEILING, known
from duels import RECORDED, kind_of
from standings import Block, blocks

BUDGET = 300
MEASURES = ("failures", "kinds", "gamma_f")


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """Mean failures, kinds and γ_f of each strategy of conf/sampler, for each kind of emulated worlds; most failures first."""
    groups: dict[str, list[Block]] = {}
    for block in blocks(rows):
        if block.budget == BUDGET:
            groups.setdefault(kind_of(block.group), []).append(block)
    tables = {kind: pd.concat([block.rows for block in group]) for kind, group in groups.items()}
    means = {
        kind: table.groupby("strategy")[list(MEASURES)].mean() for kind, table in tables.items()
    }
    strategies = [name for name in known() if name != CEILING and name in means[RECORDED].index]
    strategies.sort(key=lambda name: -float(means[RECORDED].loc[name, "failures"]))
    lines = [f"| strategy | {' | '.join(means)} |", "|---" * (len(means) + 1) + "|"]
    for name in strategies:
        cells = [_cell(table, name) for table in means.values()]
        lines.append(f"| `{name}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(means: pd.DataFrame, strategy: str) -> str:
    if strategy not in means.index:
        return "–"
    failures, kinds, gamma = (float(means.loc[strategy, measure]) for measure in MEASURES)
    return (
        f"{failures:.0f} / {kinds:.0f} / {100 * gamma:.0f} %"
        if failures >= 10
        else f"{failures:.1f} / {kinds:.1f} / {100 * gamma:.1f} %"
    )
