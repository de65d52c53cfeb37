"""Do more rounds of search and retraining help, and why does a version still fail after three? The pieces of docs/results/rounds.md.

    python benchmarks/rounds.py plan         the commands of every piece, and which are published
    python benchmarks/rounds.py keep 0       publish the piece of seed 0, which data/default holds
    python benchmarks/rounds.py answer       the page's tables

A piece is the default study with three rounds, another seed and two held-out scenarios. Beside the outcomes of every version, it publishes
how many failures of the last `adaptive` version each changed part of the loop repairs.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from outcomes import failures, of_study, write
from what_is_left import what_is_left

from pipeline.config.composing import PARAMS, load
from pipeline.core.statistics import mean_interval

PUBLISHED = Path("docs/results/rounds")
STUDY = Path("data/default")
SEEDS = range(3)
ROUNDS = range(1, 4)
ARMS = ("control", "random", "adaptive")
OVERRIDES = (
    "retraining.rounds=3 held_out=[F1star,F2star] comparison.tests=100 scenarios.F1star.people=6 scenarios.F2star.people=6"
    " scenarios.F1star.town.seed=1061 scenarios.F2star.town.seed=1063"
)
"""People and towns that no earlier result was made with."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("plan")
    commands.add_parser("keep").add_argument("seed", type=int, choices=list(SEEDS))
    commands.add_parser("answer")
    options = parser.parse_args()
    if options.command == "plan":
        print(plan())
    elif options.command == "answer":
        print(answer(*published()))
    else:
        keep(options.seed)


def plan() -> str:
    lines = []
    for seed in SEEDS:
        of_seed = f"seeds=[{seed}] retraining.seeds=[{seed}] comparison.seed={60 + seed}"
        lines += [f"# seed {seed}: {'published' if _outcomes(seed).exists() else 'missing'}"]
        lines += [f"python -m pipeline compose study=default {of_seed} {OVERRIDES}", f"./run && python benchmarks/rounds.py keep {seed}"]
    return "\n".join(lines)


def keep(seed: int) -> None:
    """Publish the finished study; SystemExit if it is of another seed. Executes the last version's failures again, for a minute."""
    write(of_study(STUDY, seed), _outcomes(seed))
    config = load(PARAMS)
    what_is_left(config, version("adaptive", ROUNDS[-1]), list(config.held_out)).to_csv(_left(seed))


def version(arm: str, after: int) -> str:
    """The name of an arm's version after a round."""
    return arm if after == 1 else f"{arm}-r{after}"


def published(folder: Path = PUBLISHED) -> tuple[list[dict[str, int]], list[pd.DataFrame]]:
    """For each published seed, the failures of every version, and what repairs those of the last: parts by scenarios."""
    seeds = [seed for seed in SEEDS if _outcomes(seed, folder).exists()]
    tables = [pd.read_csv(_outcomes(seed, folder)) for seed in seeds]
    return [failures(table) for table in tables], [pd.read_csv(_left(seed, folder), index_col="part") for seed in seeds]


def answer(failed: list[dict[str, int]], left: list[pd.DataFrame]) -> str:
    """Failures by arm and round, the change since the first round, and what repairs the failures that are left."""
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
    repaired = sum(left[1:], start=left[0])
    lines += [f"| failures of `{last}` | {' | '.join(repaired)} |", "|---" * (1 + repaired.shape[1]) + "|"]
    lines += [f"| {' | '.join(map(str, row))} |" for row in repaired.itertuples()]
    return "\n".join(lines)


def _outcomes(seed: int, folder: Path = PUBLISHED) -> Path:
    return folder / f"{seed}.csv.gz"


def _left(seed: int, folder: Path = PUBLISHED) -> Path:
    return folder / f"left-{seed}.csv"


def _counts(failed: list[dict[str, int]], name: str) -> str:
    return ", ".join(str(counts[name]) for counts in failed)


def _change(failed: list[dict[str, int]], first: str, last: str) -> str:
    """Mean difference in failures over the searches, with Student's interval if there are several."""
    differences = np.array([counts[last] - counts[first] for counts in failed])
    low, high = mean_interval(differences)
    return f"{differences.mean():+.1f}" + (f" ({low:+.1f} to {high:+.1f})" if len(differences) > 1 else "")


if __name__ == "__main__":
    main()
