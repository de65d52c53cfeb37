"""The claims of the page: the default strategy against the thesis' network, and against the best sampler of VerifAI."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from peers import VERIFAI
from picture import BUDGETS
from standings import CONFIDENCE, Block, blocks
from worlds import ANALYTIC, WorldName

from pipeline.core.statistics import bootstrap_ratio

DEFAULT, THESIS, GREEDY = "forest", "network", "exploit"


def markdown(rows: Sequence[dict[str, Any]]) -> str:
    """A table of ratios with intervals, a row for each kind of worlds (both families of emulators together) and budget."""
    tables: dict[tuple[str, int], list[Block]] = {}
    for block in blocks(rows):
        if block.budget in BUDGETS:
            tables.setdefault((_kind(block.group), block.budget), []).append(block)
    peers = sorted(VERIFAI)
    columns = {
        f"failures, {DEFAULT} / {THESIS}": ("failures", DEFAULT, [THESIS]),
        f"kinds, {DEFAULT} / {THESIS}": ("kinds", DEFAULT, [THESIS]),
        f"γ_f, {DEFAULT} / {THESIS}": ("gamma_f", DEFAULT, [THESIS]),
        f"γ_f, {DEFAULT} / best of VerifAI": ("gamma_f", DEFAULT, peers),
        f"failures, {GREEDY} / best of VerifAI": ("failures", GREEDY, peers),
    }
    lines = [f"| worlds | tests | {' | '.join(columns)} |", "|---" * (len(columns) + 2) + "|"]
    for (kind, budget), group in tables.items():
        cells = [_ratio(group, *claim) for claim in columns.values()]
        lines.append(f"| {kind} | {budget:,} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _kind(group: str) -> str:
    if group == ANALYTIC:
        return group
    share = WorldName("", group).share
    return f"{100 * share:g} % fail" if share else "as recorded"


def _ratio(group: Sequence[Block], measure: str, ours: str, others: Sequence[str]) -> str:
    """Ratio of the means over the worlds and seeds that both have, and the interval over seeds; of others, the best is compared."""
    values = {name: pd.concat([block.values(name, measure).stack() for block in group]) for name in [ours, *others]}
    known = [name for name in others if len(values[name])]
    if not known or not len(values[ours]):
        return "–"
    best = max(known, key=lambda name: float(values[name].mean()))
    seeds = pd.concat({"own": values[ours], "other": values[best]}, axis=1).dropna().groupby("seed").mean()
    own, other = seeds["own"].to_numpy(float), seeds["other"].to_numpy(float)
    if not other.sum():
        return "–"
    low, high = bootstrap_ratio(own, other, np.random.default_rng(0), CONFIDENCE)
    return f"{own.mean() / other.mean():.2f} ({low:.2f}–{high:.2f})"
