"""Which search, and which of its frames, teach a detector most? Development towns and people only: it chooses, it proves nothing.

    python benchmarks/teaching.py plan                  the commands of every piece, and which are published
    python benchmarks/teaching.py keep shares 0         publish the piece that data/teaching holds
    python benchmarks/teaching.py answer                the tables of docs/results/teaching.md

A piece is one seed, with searches and retrained versions of its own. `shares` compares searches that mix random and forest-guided tests.
The other pieces retrain on the same searches, but choose other frames of them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from outcomes import TEST, failures, of_study, write

from pipeline.core.statistics import mean_interval

PUBLISHED = Path("docs/results/teaching")
STUDY = Path("data/teaching")
SEEDS = range(3)
SHARES = {"random": "100 %", "share75": "75 %", "adaptive": "50 %", "share25": "25 %", "forest": "0 %"}
"""Version -> share of random tests in the search that it learns from."""
SELECTIONS = {
    "failures": "of failed tests",
    "causes": "as many of every cause",
    "unsure": "more where unsure",
    "missed": "more where missed",
}
"""Values of `retraining.selection`, in words."""
KINDS = ("shares", *SELECTIONS)
VERSIONS = ["base", "control", "random", "adaptive"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("plan")
    keep = commands.add_parser("keep")
    keep.add_argument("kind", choices=list(KINDS))
    keep.add_argument("seed", type=int, choices=list(SEEDS))
    commands.add_parser("answer")
    options = parser.parse_args()
    if options.command == "plan":
        print(plan())
    elif options.command == "answer":
        print(answer(published()))
    else:
        outcomes = of_study(STUDY, options.seed)
        versions = [*VERSIONS, *(name for name in SHARES if options.kind == "shares" and name not in VERSIONS)]
        write(outcomes[[*TEST, *versions]], piece_path(options.kind, options.seed))


def plan() -> str:
    lines = []
    for seed in SEEDS:
        for kind in KINDS:
            state = "published" if piece_path(kind, seed).exists() else "missing"
            choice = "" if kind == "shares" else f" retraining.selection={kind} ~arms.share75 ~arms.share25 ~arms.forest"
            of_seed = f"seeds=[{seed}] retraining.seeds=[{seed}] comparison.seed={50 + seed}"
            lines += [f"# {kind}, seed {seed}: {state}", f"python -m pipeline compose study=teaching {of_seed}{choice}"]
            lines += [f"./run && python benchmarks/teaching.py keep {kind} {seed}"]
    return "\n".join(lines)


def piece_path(kind: str, seed: int, folder: Path = PUBLISHED) -> Path:
    return folder / f"{kind}-{seed}.csv.gz"


def published(folder: Path = PUBLISHED) -> dict[tuple[str, int], pd.DataFrame]:
    """The tables of all published pieces, by kind and seed."""
    pieces = {(kind, seed): piece_path(kind, seed, folder) for kind in KINDS for seed in SEEDS}
    return {piece: pd.read_csv(path) for piece, path in pieces.items() if path.exists()}


def answer(pieces: dict[tuple[str, int], pd.DataFrame]) -> str:
    """Failures after learning from each mixture, and from each choice of frames, with the difference from random tests' frames."""
    counts = {piece: failures(table) for piece, table in pieces.items()}
    seeds = [seed for seed in SEEDS if ("shares", seed) in counts]
    if not seeds:
        return "No piece is published."
    lines = [f"{len(seeds)} of {len(SEEDS)} searches.", "", *_header("share of random tests")]
    failed = {name: np.array([counts["shares", seed][name] for seed in seeds]) for name in ("base", "control", *SHARES)}
    lines += [_row(SHARES.get(name, f"`{name}`"), found, failed["random"]) for name, found in failed.items()]
    lines += ["", *_header("frames of the search with 50 %")]
    for kind, words in {"shares": "all alike", **SELECTIONS}.items():
        done = [seed for seed in seeds if (kind, seed) in counts]
        chosen = np.array([counts[kind, seed]["adaptive"] for seed in done])
        if len(chosen):
            lines.append(_row(words, chosen, np.array([counts["shares", seed]["random"] for seed in done])))
    return "\n".join(lines)


def _header(first: str) -> list[str]:
    return [f"| {first} | failures, by search | mean | minus random tests, mean (95 %) |", "|---|---|---|---|"]


def _row(words: str, failed: np.ndarray, random: np.ndarray) -> str:
    low, high = mean_interval(failed - random)
    interval = f" ({low:+.1f} to {high:+.1f})" if len(failed) > 1 else ""
    return f"| {words} | {', '.join(map(str, failed))} | {failed.mean():.1f} | {(failed - random).mean():+.1f}{interval} |"


if __name__ == "__main__":
    main()
