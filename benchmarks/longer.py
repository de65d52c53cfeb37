"""Does a longer retraining on more frames of the same tests leave fewer failures? The pieces of docs/results/longer.md.

    python benchmarks/longer.py plan             the commands of every piece, and which are published
    python benchmarks/longer.py keep longer 0    publish the piece of seed 0, which data/retraining holds
    python benchmarks/longer.py answer           the page's tables

A piece is a search on the long-tailed base and one retraining of `adaptive`. Both pieces of a seed share the base set, the search and the
held-out tests of the base: Snakemake makes only the retraining and its tests again.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from outcomes import failures, mean_difference
from pieces import Experiment, Piece

SEEDS = range(3)
SETTINGS = {"published": "", "longer": " retraining.iterations=2400 retraining.added_frames=9000"}
"""Overrides of each kind: the recipe of docs/results/retraining.md, and three times its steps and frames."""
WORDS = {"published": "800 steps", "longer": "2,400 steps"}
ONLY = "strategies=[mixed] ~arms.control ~arms.random ~arms.fresh ~arms.balanced ~arms.pairwise ~arms.coverage ~arms.untold"
TOWNS = {
    "F1star": 1069,
    "F2star": 1087,
    "F3star": 1091,
    "F4star": 1093,
    "F5star": 1097,
    "F6star": 1103,
}
"""Seeds of towns that no earlier result was made in."""
HELD_OUT = " ".join(
    f"scenarios.{name}.people=7 scenarios.{name}.town.seed={seed}" for name, seed in TOWNS.items()
)
EXPERIMENT = Experiment(
    "longer",
    "retraining",
    {
        (kind, seed): f"comparison.seed=30 {HELD_OUT} {ONLY}{more}"
        for seed in SEEDS
        for kind, more in SETTINGS.items()
    },
)


def answer(pieces: Mapping[Piece, pd.DataFrame]) -> str:
    """Failures of the base and of `adaptive` after each retraining, of the seeds that have both."""
    seeds = [seed for seed in SEEDS if all((kind, seed) in pieces for kind in SETTINGS)]
    if not seeds:
        return "No search is published."
    counts = {kind: [failures(pieces[kind, seed]) for seed in seeds] for kind in SETTINGS}
    base = np.array([found["base"] for found in counts["published"]])
    lines = [
        f"{len(seeds)} of {len(SEEDS)} searches, {len(pieces['published', seeds[0]])} held-out tests each.",
        "",
    ]
    lines += [
        "| version | failures, by search | mean | of the base's |",
        "|---|---|---|---|",
        f"| `base` | {_counts(base)} | {base.mean():.1f} | |",
    ]
    left = {kind: np.array([found["adaptive"] for found in counts[kind]]) for kind in SETTINGS}
    for kind, failed in left.items():
        shares = ", ".join(f"{share:.2f}" for share in failed / base)
        lines.append(
            f"| `adaptive`, {WORDS[kind]} | {_counts(failed)} | {failed.mean():.1f} | {shares} |"
        )
    lines += [
        "",
        f"Longer minus published: {mean_difference(left['longer'] - left['published'])}.",
        "",
        *_by_scenario(pieces, seeds),
    ]
    return "\n".join(lines)


def _by_scenario(pieces: Mapping[Piece, pd.DataFrame], seeds: list[int]) -> list[str]:
    """The mean failures of each version on each scenario."""
    scenarios = [name.replace("star", "\\*") for name in TOWNS]
    lines = [f"| mean failures | {' | '.join(scenarios)} |", "|---" * (len(scenarios) + 1) + "|"]
    rows = {
        "`base`": ("published", "base"),
        **{f"`adaptive`, {WORDS[kind]}": (kind, "adaptive") for kind in SETTINGS},
    }
    for words, (kind, version) in rows.items():
        found = [
            [failures(table)[version] for _, table in pieces[kind, seed].groupby("scenario")]
            for seed in seeds
        ]
        lines.append(
            f"| {words} | {' | '.join(f'{mean:.1f}' for mean in np.mean(found, axis=0))} |"
        )
    return lines


def _counts(failed: np.ndarray) -> str:
    return ", ".join(map(str, failed))


if __name__ == "__main__":
    EXPERIMENT.main(__doc__, answer)
