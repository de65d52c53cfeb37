"""Does adaptive data make a better detector? The pieces of the experiment in docs/results/retraining.md.

    python benchmarks/retraining.py plan                          the commands of every piece, and which are published
    python benchmarks/retraining.py keep long_tailed 0            publish the piece that data/retraining holds
    python benchmarks/retraining.py answer                        the page's tables

A piece is one base detector and one seed: `study=retraining` with searches, retrained versions and held-out tests of its own. Its outcomes
are published as a row for each held-out test and a column for each version: 0 passed, 1 failed, 2 ended in an error.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artefacts.tables import read_tests
from pipeline.core.statistics import mean_interval

PUBLISHED = Path("docs/results/retraining")
STUDY = Path("data/retraining")
SEEDS = range(5)
BASES = {
    "long_tailed": "",
    "uniform": (
        " base.weights=models/uniform base_set.rare.children=1 base_set.rare.crouching=1 strategies=[random,mixed,untold]"
        " ~arms.fresh ~arms.pairwise ~arms.coverage"
    ),
}
"""The overrides of each base. With a uniform base, new scenes are balanced anyway; three arms are left out to save a third of the time."""
TEST = ["scenario", "index", "animation", "blueprint"]
PASSED, FAILED, ERROR = 0, 1, 2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("plan")
    keep = commands.add_parser("keep")
    keep.add_argument("base", choices=list(BASES))
    keep.add_argument("seed", type=int, choices=list(SEEDS))
    commands.add_parser("answer")
    options = parser.parse_args()
    if options.command == "plan":
        print(plan())
    elif options.command == "answer":
        print(answer(published()))
    else:
        path = piece_path(options.base, options.seed)
        path.parent.mkdir(parents=True, exist_ok=True)
        outcomes(STUDY, options.seed).to_csv(path, index=False, compression={"method": "gzip", "mtime": 0})
        print(path)


def plan() -> str:
    lines = []
    for seed in SEEDS:
        for base, overrides in BASES.items():
            state = "published" if piece_path(base, seed).exists() else "missing"
            lines += [f"# {base}, seed {seed}: {state}"]
            lines += [f"python -m pipeline compose study=retraining seeds=[{seed}] retraining.seeds=[{seed}]{overrides}"]
            lines += [f"./run && python benchmarks/retraining.py keep {base} {seed}"]
    return "\n".join(lines)


def piece_path(base: str, seed: int, folder: Path = PUBLISHED) -> Path:
    return folder / f"{base}-{seed}.csv.gz"


def outcomes(study: Path, seed: int) -> pd.DataFrame:
    """A row for each held-out test: `TEST`, and a column for each version. SystemExit if the study holds another seed."""
    parts = [read_tests(path) for path in sorted(study.glob("held_out/*/*/*/*/tests.parquet"))]
    searched = {path.parent.name for path in study.glob("campaigns/*/*/base/*/tests.parquet")}
    if not parts or searched != {str(seed)}:
        raise SystemExit(f"{study}: expected a finished study whose searches have seed {seed}, found {sorted(searched) or 'none'}")
    tests = pd.concat(parts, ignore_index=True)
    tests["outcome"] = np.where(tests["status"] != "ok", ERROR, tests["failure"].astype(int))
    table = tests.pivot(index=TEST, columns="version", values="outcome")
    if table.isna().to_numpy().any():
        raise SystemExit(f"{study}: the versions were not tested on the same tests; finish the study with ./run")
    return table.astype(int).reset_index()


def published(folder: Path = PUBLISHED) -> dict[tuple[str, int], pd.DataFrame]:
    """The tables of all published pieces, by base and seed."""
    pieces = {(base, seed): piece_path(base, seed, folder) for base in BASES for seed in SEEDS}
    return {piece: pd.read_csv(path) for piece, path in pieces.items() if path.exists()}


def answer(pieces: dict[tuple[str, int], pd.DataFrame]) -> str:
    """Failures of every version, and what `adaptive` fails less than each of them, over the seeds of a base."""
    parts = [
        f"{len(pieces)} of {len(BASES) * len(SEEDS)} pieces are published.",
        *(_of_base(base, [pieces[base, seed] for seed in SEEDS if (base, seed) in pieces]) for base in BASES),
    ]
    return "\n\n".join(part for part in parts if part)


def _of_base(base: str, tables: list[pd.DataFrame]) -> str:
    if not tables:
        return ""
    versions = [name for name in tables[0].columns if name not in TEST]
    versions.sort(key=["base", "control", "fresh", "balanced", "random", "pairwise", "coverage", "untold", "adaptive"].index)
    failed = {name: np.array([_failures(table, name) for table in tables]) for name in versions}
    lines = [
        f"**Base `{base}`**, {len(tables)} searches, {len(tables[0])} held-out tests each:",
        "",
        "| version | failures, by search | mean (95 %) | `adaptive` minus it, mean (95 %) |",
        "|---|---|---|---|",
    ]
    for name in versions:
        difference = "–" if name == "adaptive" else _interval(failed["adaptive"] - failed[name])
        each = ", ".join(str(count) for count in failed[name])
        lines.append(f"| `{name}` | {each} | {_interval(failed[name])} | {difference} |")
    return "\n".join(lines)


def _failures(table: pd.DataFrame, version: str) -> int:
    """Failures of a version among the tests that no version ended in an error."""
    versions = [name for name in table.columns if name not in TEST]
    return int((table.loc[(table[versions] != ERROR).all(axis=1), version] == FAILED).sum())


def _interval(values: np.ndarray) -> str:
    low, high = mean_interval(values)
    return f"{values.mean():.1f}" if len(values) == 1 else f"{values.mean():.1f} ({low:.1f} to {high:.1f})"


if __name__ == "__main__":
    main()
