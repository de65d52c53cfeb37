"""The claims of the page: the default strategy against the thesis' network, the default before it, and the best sampler of VerifAI."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from peers import VERIFAI
from picture import BUDGETS
from standings import CONFIDENCE, Block, blocks
from worlds import ANALYTIC, WorldName

from pipeline.core.statistics import bootstrap_ratio

DEFAULT, THESIS, FORMER, GREEDY = "forest", "network", "neural", "exploit"
BEST = "best of VerifAI"
OTHERS = (THESIS, FORMER, BEST)
SYMBOLS = {"failures": "failures", "kinds": "kinds", "gamma_f": "γ_f"}
LINE = 128
"""Length of a line of prose."""
RECORDED, RARE, RAREST = "as recorded", "1.5 % fail", "0.1 % fail"


@dataclass(frozen=True)
class Duel:
    """What two strategies are compared in. other: a strategy, or `BEST`."""

    measure: str
    ours: str
    other: str

    def __str__(self) -> str:
        return f"{SYMBOLS[self.measure]}, {self.ours} / {self.other}"


@dataclass(frozen=True)
class Ratio:
    """Ratio of two means with its interval over seeds."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f}–{self.high:.2f})"


FAILURES, KINDS, PAIRS = (Duel(measure, DEFAULT, THESIS) for measure in SYMBOLS)
FORMER_FAILURES, FORMER_PAIRS = Duel("failures", DEFAULT, FORMER), Duel("gamma_f", DEFAULT, FORMER)
PEER_PAIRS, PEER_FAILURES = Duel("gamma_f", DEFAULT, BEST), Duel("failures", GREEDY, BEST)
DUELS = (FAILURES, KINDS, PAIRS, FORMER_FAILURES, FORMER_PAIRS, PEER_PAIRS, PEER_FAILURES)
EXPECTED = (
    (FAILURES, RECORDED, 300, 1.5),
    (FAILURES, RECORDED, 1000, 1.1),
    (KINDS, RECORDED, 300, 1.3),
    (KINDS, RECORDED, 1000, 1.3),
    (PAIRS, RECORDED, 300, 1.4),
    (PAIRS, RECORDED, 1000, 1.25),
    (FAILURES, RARE, 300, 2.5),
    (PAIRS, RARE, 300, 1.5),
    (FAILURES, RAREST, 300, 2.5),
    (PAIRS, RAREST, 300, 1.5),
    (FAILURES, ANALYTIC, 1000, 1.2),
    (PAIRS, ANALYTIC, 1000, 1.15),
    *(
        (FORMER_FAILURES, kind, budget, 1.25)
        for kind in (RECORDED, RARE, RAREST, ANALYTIC)
        for budget in (300, 1000)
    ),
    *(
        (FORMER_PAIRS, kind, budget, 1.15)
        for kind in (RECORDED, RARE, RAREST, ANALYTIC)
        for budget in (300, 1000)
    ),
    (PEER_PAIRS, RECORDED, 300, 1.9),
    (PEER_PAIRS, RECORDED, 1000, 1.6),
    (PEER_FAILURES, RECORDED, 300, 0.97),
    (PEER_FAILURES, RECORDED, 1000, 0.97),
)
"""Duel, worlds, tests and the smallest ratio; fixed before the runs that judge."""
Ratios = Mapping[tuple[Duel, str, int], Ratio]


def ratios(rows: Sequence[dict[str, Any]]) -> Ratios:
    """Every duel in every kind of worlds (both families of emulators together) after each budget, as far as it was run."""
    found = {
        (duel, *kind): ratio(group, duel) for kind, group in kinds(rows).items() for duel in DUELS
    }
    return {key: one for key, one in found.items() if one is not None}


def kinds(
    rows: Sequence[dict[str, Any]], budgets: Sequence[int] = BUDGETS
) -> dict[tuple[str, int], list[Block]]:
    """The blocks of every kind of worlds, both families of emulators together, after each budget."""
    groups: dict[tuple[str, int], list[Block]] = {}
    for block in blocks(rows):
        if block.budget in budgets:
            groups.setdefault((kind_of(block.group), block.budget), []).append(block)
    return groups


def markdown(found: Ratios) -> str:
    """A table of the ratios, a row for each kind of worlds and budget."""
    lines = [f"| worlds | tests | {' | '.join(map(str, DUELS))} |", "|---" * (len(DUELS) + 2) + "|"]
    for kind, budget in dict.fromkeys((kind, budget) for _, kind, budget in found):
        cells = [str(found.get((duel, kind, budget), "–")) for duel in DUELS]
        lines.append(f"| {kind} | {budget:,} | {' | '.join(cells)} |")
    return "\n".join(lines)


def answer(found: Ratios, others: Collection[str] = OTHERS) -> str:
    """The expectations against some strategies that do not hold, how many do, and the table of all."""
    rows, short = [], []
    expected = [each for each in EXPECTED if each[0].other in others]
    for duel, kind, budget, least in expected:
        one = found.get((duel, kind, budget))
        reached = "not run" if one is None else "yes" if one.value >= least else "**no**"
        rows.append(f"| {duel} | {kind} | {budget:,} | {least:g} | {one or '–'} | {reached} |")
        if one is not None and one.value < least:
            short.append(
                f"{duel} after {budget:,} tests, {kind}: {one.value:.2f} instead of {least:g}"
            )
    judged = sum((duel, kind, budget) in found for duel, kind, budget, _ in expected)
    missed = f"**What fell short:** {'; '.join(short)}. " if short else ""
    head = fill(f"{missed}{judged - len(short)} of {judged} expectations hold.", LINE)
    table = [
        "| ratio | worlds | tests | expected at least | found | reached |",
        "|---|---|---|---|---|---|",
        *rows,
    ]
    return "\n".join([head, "", *table])


def kind_of(group: str) -> str:
    """The worlds of a group in words, the same for both families of emulators."""
    if group == ANALYTIC:
        return group
    share = WorldName("", group).share
    return f"{100 * share:g} % fail" if share else RECORDED


def ratio(group: Sequence[Block], duel: Duel) -> Ratio | None:
    """Ratio of the means over the worlds and seeds that both have; None if one was not run."""
    others = sorted(VERIFAI) if duel.other == BEST else [duel.other]
    values = {
        name: pd.concat([block.values(name, duel.measure).stack() for block in group])
        for name in [duel.ours, *others]
    }
    known = [name for name in others if len(values[name])]
    if not known or not len(values[duel.ours]):
        return None
    best = max(known, key=lambda name: float(values[name].mean()))
    seeds = (
        pd.concat({"own": values[duel.ours], "other": values[best]}, axis=1)
        .dropna()
        .groupby("seed")
        .mean()
    )
    own, other = seeds["own"].to_numpy(float), seeds["other"].to_numpy(float)
    if not other.sum():
        return None
    return Ratio(
        own.mean() / other.mean(),
        *bootstrap_ratio(own, other, np.random.default_rng(0), CONFIDENCE),
    )
