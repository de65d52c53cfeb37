"""Do more rounds of search and retraining help, and why does a version still fail after three? The pieces of docs/results/rounds.md.

    python benchmarks/rounds.py plan             the commands of every piece, and which are published
    python benchmarks/rounds.py keep three 0     publish the piece of seed 0, which data/default holds
    python benchmarks/rounds.py answer | draw    the page's tables, its figure

A piece is the default study with three rounds, another seed and two held-out scenarios. Beside the outcomes of every version, `three`
publishes how many failures of the last `adaptive` version each changed part of the loop repairs. The other kinds change the detector and
have no arm but `adaptive`: `pixels` gives it 480x288 pixels, `small` a larger network, whose base is trained first:

    python -m pipeline compose study=long_tailed training.size=small && ./run
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from outcomes import TEST, failures, mean_difference, valid
from pieces import Experiment, Piece
from what_is_left import as_table

from pipeline.report.style import legend_below, panels, series_colours, styled

SEEDS = range(3)
ROUNDS = range(1, 4)
ARMS = ("control", "random", "adaptive")
OVERRIDES = (
    "retraining.rounds=3 held_out=[F1star,F2star] comparison.tests=100 scenarios.F1star.people=6 scenarios.F2star.people=6"
    " scenarios.F1star.town.seed=1061 scenarios.F2star.town.seed=1063"
)
"""People and towns that no earlier result was made with."""
PLAIN = "three"
CHANGES = {"small": "a network of size `small`", "pixels": "480×288 pixels"}
SETTINGS = {
    PLAIN: "",
    "small": " base.weights=data/long_tailed/models/base",
    "pixels": " camera=480x288",
}
ALONE = " ~arms.random ~arms.control strategies=[mixed]"


def version(arm: str, after: int) -> str:
    """The name of an arm's version after a round."""
    return arm if after == 1 else f"{arm}-r{after}"


LAST = version("adaptive", ROUNDS[-1])


def overrides(kind: str, seed: int) -> str:
    """The arguments of `compose` after the study and its seeds."""
    return (
        f"comparison.seed={60 + seed} {OVERRIDES}{SETTINGS[kind]}{ALONE if kind in CHANGES else ''}"
    )


PIECES = {(kind, seed): overrides(kind, seed) for kind in SETTINGS for seed in SEEDS}
EXPERIMENT = Experiment(
    "rounds",
    "default",
    PIECES,
    explained=lambda kind: LAST if kind == PLAIN else None,
    figure=lambda pieces: figure(pieces),
)


def answer(pieces: Mapping[Piece, pd.DataFrame]) -> str:
    """The page's tables, with what is left as it is published beside the outcomes."""
    three = {piece: table for piece, table in pieces.items() if piece[0] == PLAIN}
    left = [pd.read_csv(EXPERIMENT.left(piece), index_col="part") for piece in three]
    if not three:
        return "No piece is published."
    return "\n\n".join(
        [tables([failures(table) for table in three.values()], left), changed(pieces)]
    )


def figure(pieces: Mapping[Piece, pd.DataFrame]) -> Figure:
    """The failures of every arm after every round: a dot for each search, lines join the means."""
    failed = [failures(table) for (kind, _), table in pieces.items() if kind == PLAIN]
    with styled():
        drawn, [[axis]] = panels(1, 1, width=5.6, height=3.2)
        for shift, (arm, colour) in zip(
            (-0.05, 0, 0.05), series_colours(ARMS).items(), strict=True
        ):
            counts = np.array(
                [
                    [each[name] for name in ("base", *(version(arm, after) for after in ROUNDS))]
                    for each in failed
                ]
            )
            at = np.arange(counts.shape[1]) + shift
            axis.plot(at, counts.mean(axis=0), color=colour, label=arm)
            axis.scatter(
                np.tile(at, len(counts)), counts, color=colour, s=18, alpha=0.6, linewidths=0
            )
        axis.set_xticks(range(len(ROUNDS) + 1), ["base", *(f"round {after}" for after in ROUNDS)])
        axis.set(ylabel="failures in 200 held-out tests", ylim=(0, None))
        legend_below(drawn, [axis])
    return drawn


def tables(failed: list[dict[str, int]], left: list[pd.DataFrame]) -> str:
    """Failures by arm and round, the change since the first round, and what repairs the failures that are left: parts by scenarios."""
    lines = [f"{len(failed)} of {len(SEEDS)} searches.", ""]
    lines += [
        "| version | "
        + " | ".join(f"round {after}" for after in ROUNDS)
        + " | last minus first, mean (95 %) |",
        "|---" * 5 + "|",
    ]
    lines += [f"| `base` | {_counts(failed, 'base')} | | | |"]
    for arm in ARMS:
        cells = " | ".join(_counts(failed, version(arm, after)) for after in ROUNDS)
        lines.append(
            f"| `{arm}` | {cells} | {_change(failed, version(arm, ROUNDS[0]), version(arm, ROUNDS[-1]))} |"
        )
    lines += [
        "",
        f"`{LAST}` minus `{version('random', ROUNDS[-1])}`: {_change(failed, version('random', ROUNDS[-1]), LAST)}.",
        "",
    ]
    lines += [as_table(left, LAST)]
    return "\n".join(lines)


def changed(pieces: Mapping[Piece, pd.DataFrame]) -> str:
    """What another detector fails in the same tests, beside what other frames alone change, as Markdown."""
    cells = [
        "instead of `adaptive`",
        "base",
        "round 1",
        "round 3",
        f"minus `{LAST}`, mean (95 %)",
        f"of the failures of `{LAST}`, passed",
    ]
    lines = [
        f"| {' | '.join(cells)} |",
        "|---" * len(cells) + "|",
        *_beside(pieces, PLAIN, "random", "`random`: other frames alone"),
    ]
    for kind, words in CHANGES.items():
        lines += _beside(pieces, kind, "adaptive", words)
    return "\n".join(lines)


def _beside(pieces: Mapping[Piece, pd.DataFrame], kind: str, arm: str, words: str) -> list[str]:
    """The row of an arm of a kind, over the searches that are published of it; none without."""
    pairs = [
        (pieces[PLAIN, seed], pieces[kind, seed])
        for seed in SEEDS
        if {(kind, seed), (PLAIN, seed)} <= set(pieces)
    ]
    if not pairs:
        return []
    both = [
        valid(plain.merge(other, on=TEST, suffixes=(", plain", ""), validate="one_to_one"))
        for plain, other in pairs
    ]
    versions = ("base", version(arm, ROUNDS[0]), version(arm, ROUNDS[-1]))
    counts = [", ".join(str(failed[name].sum()) for failed in both) for name in versions]
    before, after = ([failed[name] for failed in both] for name in (f"{LAST}, plain", versions[-1]))
    difference = mean_difference(
        [new.sum() - old.sum() for old, new in zip(before, after, strict=True)]
    )
    passed = sum((old & ~new).sum() for old, new in zip(before, after, strict=True))
    return [
        f"| {' | '.join([words, *counts, difference])} | {passed} of {sum(old.sum() for old in before)} |"
    ]


def _counts(failed: list[dict[str, int]], name: str) -> str:
    return ", ".join(str(counts[name]) for counts in failed)


def _change(failed: list[dict[str, int]], first: str, last: str) -> str:
    return mean_difference([counts[last] - counts[first] for counts in failed])


if __name__ == "__main__":
    EXPERIMENT.main(__doc__, answer)
