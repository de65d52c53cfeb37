"""Does adaptive data make a better detector? The pieces of the experiment in docs/results/retraining.md.

    python benchmarks/retraining.py plan                          the commands of every piece, and which are published
    python benchmarks/retraining.py keep long_tailed 0            publish the piece that data/retraining holds
    python benchmarks/retraining.py answer | draw                 the page's tables, its figure

A piece is one base detector and one seed: `study=retraining` with searches and retrained versions of its own. All pieces share the same
held-out tests. A piece is published as a row for each held-out test and a column for each version: 0 passed, 1 failed, 2 ended in an error.
Beside it, `keep` publishes how many failures of `adaptive` each changed part of the loop repairs (what_is_left.py), which takes minutes.

`fewer` and `more` are judged by p-values, those of the secondary questions together by Holm's method. `equivalent` is judged for each
contrast alone, by its unadjusted 95 % interval: a difference as large as the margin is called equivalent with a probability of at most
2.5 %. Over several contrasts, that some equivalence is wrong is more likely.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from outcomes import TEST, failures, p_text, student_p, valid
from pieces import Experiment, Piece
from what_is_left import as_table

from pipeline.core.statistics import mean_interval
from pipeline.report.style import SERIES, panels, styled

SEEDS = range(5)
BASES = {
    "long_tailed": "",
    "uniform": (
        "base.weights=models/uniform base_set.rare.children=1 base_set.rare.crouching=1 strategies=[random,mixed,untold]"
        " ~arms.fresh ~arms.pairwise ~arms.coverage"
    ),
}
"""The overrides of each base. With a uniform base, new scenes are balanced anyway; three arms are left out to save a third of the time."""
VERSIONS = [
    "base",
    "control",
    "fresh",
    "balanced",
    "random",
    "pairwise",
    "coverage",
    "untold",
    "adaptive",
]
TAUGHT = ["random", "pairwise", "coverage", "untold", "adaptive"]
"""The versions that learnt from tests."""
STAYS = 0.9
"""A failure stays if this share of the versions in `TAUGHT`, over all searches, has it."""
PRIMARY = ("long_tailed", "random")
"""The primary question: does `adaptive` fail less than this version of this base?"""
ALPHA = 0.05


EXPERIMENT = Experiment(
    "retraining",
    "retraining",
    {(base, seed): arguments for seed in SEEDS for base, arguments in BASES.items()},
    explained=lambda base: "adaptive",
    figure=lambda pieces: figure(pieces),
)


def answer(pieces: Mapping[Piece, pd.DataFrame]) -> str:
    """Failures of every version, and what `adaptive` fails less than each of them, over the seeds of a base."""
    failed = {
        base: _failures([pieces[base, seed] for seed in SEEDS if (base, seed) in pieces])
        for base in BASES
    }
    found = {
        (base, name): _contrast(failed[base], name)
        for base in BASES
        for name in failed[base]
        if name != "adaptive"
    }
    _adjust([contrast for question, contrast in found.items() if question != PRIMARY])
    parts = [f"{len(pieces)} of {len(BASES) * len(SEEDS)} pieces are published."]
    for base, counts in failed.items():
        if counts:
            tests = next(len(table) for (of, _), table in pieces.items() if of == base)
            parts += [
                _table(
                    base,
                    tests,
                    counts,
                    {name: contrast for (of, name), contrast in found.items() if of == base},
                )
            ]
            parts += [_stays([table for (of, _), table in pieces.items() if of == base])]
            parts += _repairs(
                [piece for piece in pieces if piece[0] == base and EXPERIMENT.left(piece).exists()]
            )
    return "\n\n".join(parts)


def figure(pieces: Mapping[Piece, pd.DataFrame]) -> Figure:
    """The failures of every version: a dot for each search, a line for the mean; a panel for each base."""
    with styled():
        drawn, [axes] = panels(1, len(BASES), width=4.6, height=3.0)
        for axis, base in zip(axes, BASES, strict=True):
            failed = _failures([pieces[base, seed] for seed in SEEDS if (base, seed) in pieces])
            for place, (name, counts) in enumerate(failed.items()):
                colour = SERIES[1] if name in TAUGHT else SERIES[0]
                axis.scatter(
                    place + np.linspace(-0.2, 0.2, len(counts)),
                    counts,
                    color=colour,
                    s=18,
                    alpha=0.6,
                    linewidths=0,
                )
                axis.hlines(counts.mean(), place - 0.35, place + 0.35, color=colour)
            axis.set_xticks(range(len(failed)), list(failed), rotation=40, ha="right")
            axis.set(title=f"base {base}", ylim=(0, None))
        axes[0].set(ylabel="failures in 600 held-out tests")
    return drawn


@dataclass
class Contrast:
    """How many more failures `adaptive` has than another version, over the searches of a base."""

    mean: float
    low: float
    high: float
    margin: float
    """Smallest effect of interest: a tenth of the base's failures."""
    p_value: float
    """Student's t-test of the mean; 1 if all differences are equal. Adjusted by Holm's method if the question is not the primary one."""

    @property
    def verdict(self) -> str:
        if self.p_value <= ALPHA:
            return "fewer" if self.mean < 0 else "more"
        # The interval is not adjusted: each equivalence stands for itself.
        return "equivalent" if -self.margin < self.low and self.high < self.margin else "not shown"


def _contrast(failed: dict[str, np.ndarray], name: str) -> Contrast:
    differences = failed["adaptive"] - failed[name]
    if not np.ptp(
        differences
    ):  # One search, or several that differ equally: nothing tells their spread.
        return Contrast(differences.mean(), -np.inf, np.inf, 0.0, 1.0)
    return Contrast(
        differences.mean(),
        *mean_interval(differences),
        failed["base"].mean() / 10,
        student_p(differences),
    )


def _adjust(contrasts: list[Contrast]) -> None:
    """Holm's step-down method: with probability 1 - ALPHA, no contrast without a difference is called shown."""
    adjusted = 0.0
    for rank, contrast in enumerate(sorted(contrasts, key=lambda each: each.p_value)):
        adjusted = max(adjusted, min(1.0, (len(contrasts) - rank) * contrast.p_value))
        contrast.p_value = adjusted


def _table(
    base: str, tests: int, failed: dict[str, np.ndarray], contrasts: dict[str, Contrast]
) -> str:
    searches = len(failed["base"])
    lines = [
        f"**Base `{base}`**, {searches} {'search' if searches == 1 else 'searches'}, {tests} held-out tests each:",
        "",
        "| version | failures, by search | mean (95 %) | `adaptive` minus it, mean (95 %) | p | `adaptive` fails |",
        "|---|---|---|---|---|---|",
    ]
    for name, counts in failed.items():
        each = ", ".join(str(count) for count in counts)
        row = f"| `{name}` | {each} | {_mean(counts.mean(), *mean_interval(counts))} |"
        if name == "adaptive":
            lines.append(f"{row} – | – | – |")
        else:
            found = contrasts[name]
            lines.append(
                f"{row} {_mean(found.mean, found.low, found.high)} | {p_text(found.p_value)} | {found.verdict} |"
            )
    return "\n".join(lines)


def _stays(tables: list[pd.DataFrame]) -> str:
    """Failures by scenario: of the base and of `adaptive` in the mean, and those that stay whatever tests a version learns from."""
    shares = (
        pd.concat([table[TEST].join(valid(table), how="inner") for table in tables])
        .groupby(TEST)
        .mean()
    )
    taught = shares[[name for name in TAUGHT if name in shares]].mean(axis=1)
    counts = {
        "mean of `base`": (shares["base"], ".1f"),
        "mean of `adaptive`": (shares["adaptive"], ".1f"),
        f"left by {100 * STAYS:.0f} % of the versions that learnt from tests": (
            taught >= STAYS,
            ".0f",
        ),
    }
    lines = []
    for name, (failed, digits) in counts.items():
        each = failed.groupby("scenario").sum()
        lines.append(
            f"| {name} | {' | '.join(f'{count:{digits}}' for count in [*each, each.sum()])} |"
        )
    scenarios = [name.replace("star", "\\*") for name in shares.index.unique("scenario")]
    return "\n".join(
        [
            f"| failures | {' | '.join(scenarios)} | all |",
            "|---" * (len(scenarios) + 2) + "|",
            *lines,
        ]
    )


def _repairs(pieces: list[Piece]) -> list[str]:
    """What repairs the failures of `adaptive`, in the pieces that say so: the first ones were published without."""
    if not pieces:
        return []
    seeds = ", ".join(str(seed) for _, seed in pieces)
    found = as_table(
        [pd.read_csv(EXPERIMENT.left(piece), index_col="part") for piece in pieces], "adaptive"
    )
    return [
        f"Failures repaired when [one part of the loop](rounds.md#setup) is replaced, seed{'s' * (len(pieces) > 1)} {seeds}:\n\n{found}"
    ]


def _failures(tables: list[pd.DataFrame]) -> dict[str, np.ndarray]:
    """By version, (searches,) failures among the tests that no version ended in an error."""
    if not tables:
        return {}
    counts = [failures(table) for table in tables]
    return {
        name: np.array([count[name] for count in counts]) for name in VERSIONS if name in counts[0]
    }


def _mean(mean: float, low: float, high: float) -> str:
    return (
        f"{mean:.1f}"
        if low == high or not np.isfinite(low)
        else f"{mean:.1f} ({low:.1f} to {high:.1f})"
    )


if __name__ == "__main__":
    EXPERIMENT.main(__doc__, answer)
