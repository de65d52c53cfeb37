"""Does adaptive data make a better detector? An experiment in pieces, each a `study=retraining`.

    python -m benchmarks.retraining plan                  the commands of each piece
    python -m benchmarks.retraining keep long_tailed 0    publish what data/retraining holds
    python -m benchmarks.retraining answer                the tables

A piece is one base detector and one seed, with its own searches and retrained versions; all pieces
share the held-out tests. It is published as a table of outcomes: a row for each held-out test and a
column for each version (0 passed, 1 failed, 2 error).

Student's t-test judges `fewer` and `more`; Holm's method adjusts the p-values of the secondary
questions together. `equivalent` is judged for each contrast alone by its unadjusted 95 % interval:
a true difference of the margin is called equivalent with a probability of at most 2.5 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.shared import (
    RESULTS,
    TEST,
    failures,
    markdown,
    of_study,
    p_text,
    student_p,
    valid,
    write,
)
from pipeline.artefacts.folders import Folders
from pipeline.config.composing import PARAMS, compose, load
from pipeline.config.schema import Config
from pipeline.core.space import Ints
from pipeline.core.statistics import mean_interval
from pipeline.errors import shown
from pipeline.workflow.jobs import Jobs, step_names
from pipeline.workflow.staleness import Staleness
from pipeline.workflow.stamping import Stamps

STUDY = "retraining"
FOLDER = RESULTS / "retraining"
SEEDS = range(5)
BASES = {
    "long_tailed": "",
    # New scenes are balanced anyway; three arms fewer save a third of the time.
    "uniform": (
        "base.weights=models/uniform base_set.rare.children=1 base_set.rare.crouching=1"
        " strategies=[random,mixed,untold] ~arms.fresh ~arms.pairwise ~arms.coverage"
    ),
}
"""The overrides of the study for each base."""
TAUGHT = ["random", "pairwise", "coverage", "untold", "adaptive"]
"""The versions that learn from tests."""
VERSIONS = ["base", "control", "fresh", "balanced", *TAUGHT]
STAYS = 0.9
"""A failure stays if this share of the versions in `TAUGHT`, over all searches, has it."""
PRIMARY = ("long_tailed", "random")
"""The primary question: does `adaptive` fail less than this version of this base?"""
ALPHA = 0.05
Piece = tuple[str, int]
"""Base and seed."""


@dataclass
class Contrast:
    """How many more failures `adaptive` has than another version, over the searches of a base.

    margin: smallest effect of interest, a tenth of the base's failures. p_value: by Student's
    t-test, 1 if all differences are equal; adjusted unless it answers the primary question.
    """

    mean: float
    low: float
    high: float
    margin: float
    p_value: float

    @classmethod
    def of(cls, failed: Mapping[str, Ints], version: str) -> Contrast:
        """The contrast with a version, from the (searches,) failures of each version."""
        differences = failed["adaptive"] - failed[version]
        mean = float(differences.mean())
        if not np.ptp(differences):  # Nothing shows their spread.
            return cls(mean, -np.inf, np.inf, 0.0, 1.0)
        margin = float(failed["base"].mean()) / 10
        return cls(mean, *mean_interval(differences), margin, student_p(differences))

    @property
    def verdict(self) -> str:
        """What the contrast shows of `adaptive`."""
        if self.p_value <= ALPHA:
            return "fewer" if self.mean < 0 else "more"
        within = -self.margin < self.low and self.high < self.margin
        return "equivalent" if within else "not shown"


def main() -> None:
    """Plan, publish or answer."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("plan")
    commands.add_parser("answer")
    publish = commands.add_parser("keep")
    publish.add_argument("base", choices=list(BASES))
    publish.add_argument("seed", type=int, choices=SEEDS)
    options = parser.parse_args()
    if options.command == "plan":
        print(plan())
    elif options.command == "keep":
        print(keep((options.base, options.seed)))
    else:
        print(answer(published()))


def pieces() -> list[Piece]:
    """All pieces, in the order of execution."""
    return [(base, seed) for seed in SEEDS for base in BASES]


def overrides(piece: Piece) -> list[str]:
    """The arguments of `compose` after the study."""
    base, seed = piece
    return [f"seeds=[{seed}]", f"retraining.seeds=[{seed}]", *BASES[base].split()]


def path_of(piece: Piece) -> Path:
    """Where a piece is published."""
    return FOLDER / f"{piece[0]}-{piece[1]}.csv.gz"


def plan() -> str:
    """The commands of each piece, and whether it is published."""
    lines = []
    for base, seed in pieces():
        state = "published" if path_of((base, seed)).exists() else "missing"
        words = " ".join(overrides((base, seed)))
        lines.append(f"# {base}, seed {seed}: {state}")
        lines.append(f"python -m pipeline compose study={STUDY} {words}")
        lines.append(f"./run && python -m benchmarks.retraining keep {base} {seed}")
    return "\n".join(lines)


def keep(piece: Piece) -> Path:
    """Publish the piece that the study's folder holds.

    Raises:
        SystemExit: The study is unfinished, params.yaml is of another piece, or other settings or
            other code made the tests.
    """
    config = load(PARAMS)
    expected = compose(STUDY, overrides(piece))
    if wrong := difference(expected.model_dump(mode="json"), config.model_dump(mode="json")):
        raise SystemExit(
            f"{PARAMS}, piece {piece[0]} {piece[1]}: {wrong}; "
            "compose and execute the piece as `plan` says"
        )
    outcomes = of_study(config)
    check_made(config)
    write(outcomes, path_of(piece))
    return path_of(piece)


def check_made(config: Config) -> None:
    """Raise SystemExit for held-out tests that other settings or other code made."""
    jobs = Jobs(config, step_names())
    staleness = Staleness(Stamps(jobs))
    for path in Folders(config).held_out("tests.parquet"):
        job = jobs.maker(path)
        if job is not None and staleness.out_of_date(job):
            reasons = ", ".join(staleness.reasons(job))
            raise SystemExit(
                f"{path}: expected the tests of {PARAMS}, got those of other settings or code "
                f"({reasons}); execute ./run"
            )


def difference(expected: Mapping[str, Any], got: Mapping[str, Any]) -> str:
    """The first dotted key of plain data with another value than expected, and both values."""
    expected, got = leaves(expected), leaves(got)
    for key in [*expected, *got]:
        if key not in expected or key not in got or expected[key] != got[key]:
            texts = [shown(each[key]) if key in each else "nothing" for each in (expected, got)]
            return f"{key}: expected {texts[0]}, got {texts[1]}"
    return ""


def leaves(plain: Any, key: str = "") -> dict[str, Any]:
    """The values of nested tables by dotted key; an empty table is a value."""
    if not isinstance(plain, dict) or not plain:
        return {key: plain}
    values: dict[str, Any] = {}
    for name, part in plain.items():
        values |= leaves(part, f"{key}.{name}" if key else name)
    return values


def published() -> dict[Piece, pd.DataFrame]:
    """The outcomes of the published pieces."""
    return {piece: pd.read_csv(path_of(piece)) for piece in pieces() if path_of(piece).exists()}


def answer(outcomes: Mapping[Piece, pd.DataFrame]) -> str:
    """Failures of each version, what `adaptive` fails less than each, and failures that stay."""
    failed, contrasts = {}, {}
    for base in BASES:
        counts = [failures(table) for piece, table in outcomes.items() if piece[0] == base]
        names = [name for name in VERSIONS if counts and name in counts[0]]
        table = pd.DataFrame(counts)
        failed[base] = {name: table[name].to_numpy() for name in names}
        for name in names:
            if name != "adaptive":
                contrasts[base, name] = Contrast.of(failed[base], name)
    adjust([contrast for question, contrast in contrasts.items() if question != PRIMARY])
    parts = [f"{len(outcomes)} of {len(pieces())} pieces are published."]
    for base, counted in failed.items():
        tables = [table for piece, table in outcomes.items() if piece[0] == base]
        if tables:
            searches = f"{len(tables)} search{'es' if len(tables) > 1 else ''}"
            parts.append(f"**Base `{base}`**, {searches}, {len(tables[0])} held-out tests each:")
            rows = [row_of(name, counted, contrasts.get((base, name))) for name in counted]
            parts.append(markdown(HEAD, rows))
            parts.append(staying(tables))
    return "\n\n".join(parts)


HEAD = (
    "version",
    "failures, by search",
    "mean (95 %)",
    "`adaptive` minus it, mean (95 %)",
    "p",
    "`adaptive` fails",
)


def row_of(version: str, failed: Mapping[str, Ints], contrast: Contrast | None) -> list[str]:
    """The cells of a version; contrast: None for `adaptive` itself."""
    counts = failed[version]
    mean = interval(counts.mean(), *mean_interval(counts))
    cells = [f"`{version}`", ", ".join(map(str, counts)), mean]
    if contrast is None:
        return [*cells, "–", "–", "–"]
    ahead = interval(contrast.mean, contrast.low, contrast.high)
    return [*cells, ahead, p_text(contrast.p_value), contrast.verdict]


def interval(mean: float, low: float, high: float) -> str:
    """A mean with its interval, if there is one."""
    if low == high or not np.isfinite(low):
        return f"{mean:.1f}"
    return f"{mean:.1f} ({low:.1f} to {high:.1f})"


def adjust(contrasts: list[Contrast]) -> None:
    """Holm's method: with probability 1 - ALPHA, no contrast without a difference is shown."""
    adjusted = 0.0
    for rank, contrast in enumerate(sorted(contrasts, key=lambda each: each.p_value)):
        adjusted = max(adjusted, min(1.0, (len(contrasts) - rank) * contrast.p_value))
        contrast.p_value = adjusted


def staying(tables: list[pd.DataFrame]) -> str:
    """Failures by scenario: of the base, of `adaptive`, and those that stay."""
    failed = [table[TEST].join(valid(table), how="inner") for table in tables]
    shares = pd.concat(failed).groupby(TEST).mean()
    taught = shares[[name for name in TAUGHT if name in shares]].mean(axis=1)
    stays = f"left by {100 * STAYS:.0f} % of the versions that learnt from tests"
    rows = []
    for name, values, digits in (
        ("mean of `base`", shares["base"], ".1f"),
        ("mean of `adaptive`", shares["adaptive"], ".1f"),
        (stays, taught >= STAYS, ".0f"),
    ):
        counts = values.groupby("scenario").sum()
        rows.append([name, *(f"{count:{digits}}" for count in (*counts, counts.sum()))])
    scenarios = [name.replace("star", "\\*") for name in shares.index.unique("scenario")]
    return markdown(["failures", *scenarios, "all"], rows)


if __name__ == "__main__":
    main()
