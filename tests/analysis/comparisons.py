"""Comparisons of model versions whose outcomes a test writes as strings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pandas as pd

from pipeline.analysis.comparison import compare
from pipeline.analysis.held_out import HeldOut
from pipeline.artefacts.comparison_results import Comparison
from pipeline.core.comparison import Bools
from pipeline.core.gate import Policy

POLICY = Policy(alpha=0.05, confidence=0.95, margin=0.5)
SIGNS = {
    ".": ("none", "none"),
    "c": ("contact", "never_seen"),
    "l": ("late", "box"),
    "f": ("false_positives", "false_positives"),
    "n": ("false_activation", "false_activation"),
    "e": ("none", "none"),
}
"""Sign of an outcome -> failure mode and cause; `.` passes, `e` is an error."""


def table(outcomes: Mapping[str, str]) -> pd.DataFrame:
    """Rows of held-out tests. outcomes: version -> one sign of `SIGNS` a test."""
    rows = []
    for version, signs in outcomes.items():
        for index, sign in enumerate(signs):
            mode, cause = SIGNS[sign]
            row = {
                "scenario": "F1star",
                "strategy": "pairwise",
                "version": version,
                "seed": 0,
                "index": index,
                "status": "error" if sign == "e" else "ok",
                "failure": sign in "clfn",
                "failure_mode": mode,
                "cause": cause,
                "false_activations": int(sign == "n"),
                "false_activation_s": 1.5 * (sign == "n"),
                "speed_loss_mps": 4.0 * (sign == "n"),
            }
            rows.append(row)
    return pd.DataFrame(rows)


def held_out(tests: pd.DataFrame) -> HeldOut:
    """Tests as `HeldOut`, versions and scenarios in order of appearance."""
    tables = {}
    for key, rows in tests.groupby(["scenario", "version"], sort=False):
        tables[key] = rows.reset_index(drop=True)
    labels = {name: name.replace("star", "*") for name in tests["scenario"].unique()}
    return HeldOut(tuple(tests["version"].unique()), labels, tables)


def scenarios(**outcomes: Mapping[str, str]) -> HeldOut:
    """Tests of several scenarios: name -> version -> signs."""
    tables = [table(signs).assign(scenario=name) for name, signs in outcomes.items()]
    return held_out(pd.concat(tables, ignore_index=True))


def allowing(rise: float, sequence: HeldOut) -> Policy:
    """The policy whose gate allows the failure rate to rise by so much, a share of tests."""
    rate = sequence.outcomes(sequence.versions[0]).rate
    return replace(POLICY, margin=rise / rate) if rate else POLICY


def compared_on(sequence: HeldOut, rise: float = 0.1, /, **named: Bools) -> Comparison:
    """The comparison of held-out tests.

    rise: that the gate allows. named: their named groups, name -> (n,) bool.
    """
    return compare(sequence, named, "digest", [], allowing(rise, sequence))


def compared(**outcomes: str) -> Comparison:
    """The comparison of versions on one scenario: version -> signs."""
    return compared_on(held_out(table(outcomes)))
