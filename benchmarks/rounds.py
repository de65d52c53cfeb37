"""Do more rounds of search and retraining help, and why does a version still fail after three? The pieces of docs/results/rounds.md.

    python benchmarks/rounds.py plan             the commands of every piece, and which are published
    python benchmarks/rounds.py keep three 0     publish the piece of seed 0, which data/default holds
    python benchmarks/rounds.py answer           the page's tables

A piece is the default study with three rounds, another seed and two held-out scenarios. Beside the outcomes of every version, it publishes
how many failures of the last `adaptive` version each changed part of the loop repairs.
"""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd
from outcomes import failures, mean_difference
from pieces import Experiment, Piece
from what_is_left import as_table, what_is_left

from pipeline.config.composing import PARAMS, load

SEEDS = range(3)
ROUNDS = range(1, 4)
ARMS = ("control", "random", "adaptive")
OVERRIDES = (
    "retraining.rounds=3 held_out=[F1star,F2star] comparison.tests=100 scenarios.F1star.people=6 scenarios.F2star.people=6"
    " scenarios.F1star.town.seed=1061 scenarios.F2star.town.seed=1063"
)
"""People and towns that no earlier result was made with."""


def publish_left(piece: Piece, _: pd.DataFrame) -> None:
    """Executes the last version's failures again, for a minute."""
    config = load(PARAMS)
    what_is_left(config, version("adaptive", ROUNDS[-1]), list(config.held_out)).to_csv(EXPERIMENT.left(piece))


EXPERIMENT = Experiment(
    "rounds", "default", {("three", seed): f"comparison.seed={60 + seed} {OVERRIDES}" for seed in SEEDS}, more=publish_left
)


def version(arm: str, after: int) -> str:
    """The name of an arm's version after a round."""
    return arm if after == 1 else f"{arm}-r{after}"


def answer(pieces: Mapping[Piece, pd.DataFrame]) -> str:
    """The page's tables, with what is left as it is published beside the outcomes."""
    left = [pd.read_csv(EXPERIMENT.left(piece), index_col="part") for piece in pieces]
    return tables([failures(table) for table in pieces.values()], left)


def tables(failed: list[dict[str, int]], left: list[pd.DataFrame]) -> str:
    """Failures by arm and round, the change since the first round, and what repairs the failures that are left: parts by scenarios."""
    if not failed:
        return "No piece is published."
    lines = [f"{len(failed)} of {len(SEEDS)} searches.", ""]
    lines += ["| version | " + " | ".join(f"round {after}" for after in ROUNDS) + " | last minus first, mean (95 %) |", "|---" * 5 + "|"]
    lines += [f"| `base` | {_counts(failed, 'base')} | | | |"]
    for arm in ARMS:
        cells = " | ".join(_counts(failed, version(arm, after)) for after in ROUNDS)
        lines.append(f"| `{arm}` | {cells} | {_change(failed, version(arm, ROUNDS[0]), version(arm, ROUNDS[-1]))} |")
    last = version("adaptive", ROUNDS[-1])
    lines += ["", f"`{last}` minus `{version('random', ROUNDS[-1])}`: {_change(failed, version('random', ROUNDS[-1]), last)}.", ""]
    lines += [as_table(left, last)]
    return "\n".join(lines)


def _counts(failed: list[dict[str, int]], name: str) -> str:
    return ", ".join(str(counts[name]) for counts in failed)


def _change(failed: list[dict[str, int]], first: str, last: str) -> str:
    return mean_difference([counts[last] - counts[first] for counts in failed])


if __name__ == "__main__":
    EXPERIMENT.main(__doc__, answer)
