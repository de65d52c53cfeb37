"""Does the default study end in a shown improvement? Ten of them, each from a fresh clone to the verdict, with a seed of its own.

    python benchmarks/default_study.py run 0 1 2     clone, set up, execute and publish these seeds; a quarter of an hour each
    python benchmarks/default_study.py answer        the tables of docs/results/default.md

The seed chooses the search, the retraining and the held-out tests. A killed run is resumed, but no longer timed. On a busy machine, the
same outcomes take longer: `--busy` leaves the time out.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import time
from pathlib import Path
from textwrap import fill

import numpy as np
import pandas as pd
from outcomes import failures, of_study, valid, write

from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.results import read
from pipeline.core.statistics import mcnemar, mean_interval

PUBLISHED = Path("docs/results/default")
CLONES = Path(".cache/default_study")
SEEDS = range(10)
VERSIONS = ["base", "control", "random", "adaptive"]
ALPHA = 0.05
LINE = 128
"""Length of a line of prose."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    execute = commands.add_parser("run")
    execute.add_argument("seed", type=int, nargs="+", choices=list(SEEDS))
    execute.add_argument("--busy", action="store_true", help="other work slows this machine: record no time")
    commands.add_parser("answer")
    options = parser.parse_args()
    if options.command == "answer":
        print(answer(*published()))
    else:
        for seed in options.seed:
            run(seed, timed=not options.busy)


def run(seed: int, timed: bool) -> None:
    """Execute a default study in a clone of HEAD, publish its outcomes, and delete the clone. A resumed study is not timed."""
    clone = CLONES / str(seed)
    timed &= not clone.exists()
    begin = time.monotonic()
    if not clone.exists():
        subprocess.run(["git", "clone", "--quiet", ".", clone], check=True)
    study = f"python -m pipeline compose study=default seeds=[{seed}] retraining.seeds=[{seed}] comparison.seed={seed}"
    subprocess.run(["bash", "-c", f"./run setup && .venv/bin/{study} && ./run"], cwd=clone, check=True)
    minutes = (time.monotonic() - begin) / 60 if timed else np.nan
    write(of_study(clone / "data/default", seed), PUBLISHED / f"{seed}.csv.gz")
    champion = read(clone / "data/default/comparison.json", Comparison).champion
    verdicts = PUBLISHED / "verdicts.csv"
    rows = pd.read_csv(verdicts) if verdicts.exists() else pd.DataFrame(columns=["seed"])
    row = pd.DataFrame([{"seed": seed, "champion": champion, "minutes": round(minutes, 1)}])
    pd.concat([rows[rows["seed"] != seed], row]).sort_values("seed").to_csv(verdicts, index=False)
    shutil.rmtree(clone)


def published(folder: Path = PUBLISHED) -> tuple[dict[int, pd.DataFrame], pd.DataFrame]:
    """The outcomes by seed, and champion and minutes by seed."""
    pieces = {seed: pd.read_csv(folder / f"{seed}.csv.gz") for seed in SEEDS if (folder / f"{seed}.csv.gz").exists()}
    return pieces, pd.read_csv(folder / "verdicts.csv", index_col="seed") if pieces else pd.DataFrame()


def answer(pieces: dict[int, pd.DataFrame], verdicts: pd.DataFrame) -> str:
    if not pieces:
        return "No study is published."
    better = {name: sum(_p_value(piece, name) <= ALPHA for piece in pieces.values()) for name in ("base", "control")}
    counts = [failures(piece) for piece in pieces.values()]
    ahead = np.array([count["adaptive"] - count["random"] for count in counts])
    low, high = mean_interval(ahead)
    interval = f" ({low:+.1f} to {high:+.1f})" if len(ahead) > 1 else ""
    head = (
        f"{len(pieces)} of {len(SEEDS)} studies are published. Version `adaptive` fails significantly less than the base "
        f"in {better['base']} of them, and less than `control` in {better['control']}. It leaves {ahead.mean():+.1f} failures"
        f"{interval} compared with `random`. A study takes {verdicts['minutes'].median():.0f} minutes (median of those timed)."
    )
    lines = [
        fill(head, LINE),
        "",
        "| seed | tests | base | `control` | `random` | `adaptive` | p, against base | p, against `control` | champion | minutes |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for (seed, piece), count in zip(pieces.items(), counts, strict=True):
        counted = " | ".join(str(number) for number in (seed, len(valid(piece)), *(count[name] for name in VERSIONS)))
        minutes = verdicts.loc[seed, "minutes"]
        took = "not timed" if np.isnan(minutes) else f"{minutes:.1f}"
        p_values = f"{_p_value(piece, 'base'):.4f} | {_p_value(piece, 'control'):.4f}"
        lines.append(f"| {counted} | {p_values} | `{verdicts.loc[seed, 'champion']}` | {took} |")
    return "\n".join(lines)


def _p_value(piece: pd.DataFrame, against: str) -> float:
    """Exact McNemar test that `adaptive` fails less than another version; 1 if it fails as often or more."""
    failed = valid(piece)
    pair = mcnemar(failed[against], failed["adaptive"])
    return pair.p_value if pair.fixes > pair.regressions else 1.0


if __name__ == "__main__":
    main()
