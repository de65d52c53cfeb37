"""Does the default study end in a shown improvement? Ten of them, each from a fresh clone to the verdict, with a seed of its own.

    python benchmarks/default_study.py run 0 1 2        clone, set up, execute and publish these seeds; a quarter of an hour each
    python benchmarks/default_study.py run 0 --again    publish seed 0 beside its first outcomes, to compare two executions
    python benchmarks/default_study.py run 2 --again --ship    and put its versions into models/published
    python benchmarks/default_study.py check            compare a finished `study=published` with the outcomes of these versions
    python benchmarks/default_study.py answer           the tables of docs/results/default.md

The seed chooses the search, the retraining and the held-out tests. A killed run is resumed, but no longer timed. On a busy machine, the
same outcomes take longer: `--busy` leaves the time out.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill

import numpy as np
import pandas as pd
from outcomes import TEST, failures, mean_difference, of_study, p_text, valid, write

from pipeline.analysis.region_sentence import subject
from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.region_results import FailureRegions, RuleCondition
from pipeline.artefacts.results import read
from pipeline.config.composing import PARAMS, compose, load
from pipeline.core.lineage import VERSION_FILES
from pipeline.core.statistics import mcnemar

PUBLISHED = Path("docs/results/default")
AGAIN = PUBLISHED / "again"
CLONES = Path(".cache/default_study")
EXECUTED = Path(".cache/executed_for")
"""In a finished clone, the folder that publishes it."""
SHIPPED = Path("models/published")
SHIPPED_VERSIONS = ("base", "random", "adaptive")
SEEDS = range(10)
VERSIONS = ["base", "control", "random", "adaptive"]
ALPHA = 0.05
REGION = ["seed", "scenario", "cause", "failures", "tests_inside", "failures_inside", "conditions"]
PLANTED = ("children", "crouching")
LINE = 128
"""Length of a line of prose."""


@dataclass(frozen=True)
class Studies:
    """Published studies. outcomes: by seed. verdicts: champion and minutes by seed. regions: the largest of each seed first."""

    outcomes: Mapping[int, pd.DataFrame]
    verdicts: pd.DataFrame
    regions: pd.DataFrame


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    execute = commands.add_parser("run")
    execute.add_argument("seed", type=int, nargs="+", choices=list(SEEDS))
    execute.add_argument(
        "--busy", action="store_true", help="other work slows this machine: record no time"
    )
    execute.add_argument(
        "--again",
        action="store_true",
        help="the seeds are published already: publish a second execution's outcomes, too",
    )
    execute.add_argument(
        "--ship",
        action="store_true",
        help=f"put the versions into {SHIPPED}, for `study=published`",
    )
    execute.add_argument(
        "--keep", action="store_true", help=f"leave the finished clone in {CLONES}"
    )
    commands.add_parser("check")
    commands.add_parser("answer")
    options = parser.parse_args()
    if options.command == "check":
        config = compose("published", [])
        print(check(of_study(config), pd.read_csv(AGAIN / f"{config.comparison.seed}.csv.gz")))
    elif options.command == "answer":
        studies, again = published(), published(AGAIN)
        print(
            "\n".join([answer(studies, timed_minutes(studies, again)), *repeated(studies, again)])
        )
    else:
        for seed in options.seed:
            clone = run(seed, not options.busy, AGAIN if options.again else PUBLISHED)
            if options.ship:
                ship(clone)
            if not options.keep:
                shutil.rmtree(clone)


def run(seed: int, timed: bool, folder: Path) -> Path:
    """Execute a default study in a clone of HEAD, publish its outcomes in a folder, and return the clone. A resumed study is not timed."""
    clone = CLONES / str(seed)
    check_clone(clone, folder)
    timed &= not clone.exists()
    begin = time.monotonic()
    if not clone.exists():
        subprocess.run(["git", "clone", "--quiet", ".", clone], check=True)
    study = f"python -m pipeline compose study=default seeds=[{seed}] retraining.seeds=[{seed}] comparison.seed={seed}"
    subprocess.run(
        ["bash", "-c", f"./run setup && .venv/bin/{study} && ./run"], cwd=clone, check=True
    )
    minutes = (time.monotonic() - begin) / 60 if timed else np.nan
    publish(clone, seed, minutes, folder)
    (clone / EXECUTED).write_text(str(folder))
    return clone


def check_clone(clone: Path, folder: Path) -> None:
    """SystemExit if a clone that is already there cannot become the study that the folder publishes: then `./run` would do nothing."""
    if not clone.exists():
        return
    heads = [
        subprocess.run(
            ["git", "rev-parse", "HEAD"], cwd=each, check=True, capture_output=True
        ).stdout
        for each in (clone, ".")
    ]
    if heads[0] != heads[1]:
        raise SystemExit(
            f"{clone} is a clone of another commit; delete it to execute the study once more"
        )
    if (executed := clone / EXECUTED).exists() and executed.read_text() != str(folder):
        raise SystemExit(
            f"{clone} is the execution that {executed.read_text()} publishes; delete it to execute the study once more"
        )


def publish(clone: Path, seed: int, minutes: float, folder: Path) -> None:
    """Publish the outcomes, the verdict and the failure regions of a finished study."""
    folder.mkdir(parents=True, exist_ok=True)
    outcomes = of_study(load(clone / PARAMS), clone)
    champion = read(clone / "data/default/comparison.json", Comparison).champion
    verdicts = folder / "verdicts.csv"
    rows = pd.read_csv(verdicts) if verdicts.exists() else pd.DataFrame(columns=["seed"])
    row = pd.DataFrame([{"seed": seed, "champion": champion, "minutes": round(minutes, 1)}])
    pd.concat([rows[rows["seed"] != seed], row]).sort_values("seed").to_csv(verdicts, index=False)
    publish_regions(clone / "data/default", seed, folder / "regions.csv")
    write(outcomes, folder / f"{seed}.csv.gz")  # Last: a seed with outcomes is published.


def ship(clone: Path) -> None:
    """Copy the weights, cards and curves of a finished study's versions, so that each can be the base of another study."""
    folders = Folders(load(clone / PARAMS))
    for version in SHIPPED_VERSIONS:
        target = SHIPPED / version
        target.mkdir(parents=True, exist_ok=True)
        for kind in ("weights", "card", "curve"):
            shutil.copyfile(
                clone / folders.model(version, VERSION_FILES[kind]), target / VERSION_FILES[kind]
            )


def check(here: pd.DataFrame, there: pd.DataFrame) -> str:
    """How the outcomes of the shipped versions, executed here, differ from the published ones; SystemExit if the tests are others."""
    if not here[TEST].equals(there[TEST]):
        raise SystemExit(
            "expected the published held-out tests, got others; compose study=published without changes"
        )
    lines = [
        f"| version | failures | published | of {len(here)} outcomes, different |",
        "|---|---|---|---|",
    ]
    for name in SHIPPED_VERSIONS:
        lines.append(
            f"| `{name}` | {failures(here)[name]} | {failures(there)[name]} | {here[name].ne(there[name]).sum()} |"
        )
    return "\n".join(lines)


def publish_regions(study: Path, seed: int, path: Path) -> None:
    """Publish the failure regions that a study found in its base detector."""
    found = [read(each, FailureRegions) for each in sorted((study / "regions/base").glob("*.json"))]
    rows = [
        {
            "seed": seed,
            "scenario": of_scenario.scenario,
            "cause": region.cause,
            "failures": len(region.members),
            "tests_inside": region.support,
            "failures_inside": region.failures_inside,
            "conditions": json.dumps([condition.model_dump() for condition in region.conditions]),
        }
        for of_scenario in found
        for region in of_scenario.regions
    ]
    table = pd.DataFrame(rows, columns=REGION)
    if path.exists():
        earlier = pd.read_csv(path)
        table = pd.concat([earlier[earlier["seed"] != seed], table])
    table.sort_values(["seed", "failures"], ascending=[True, False], kind="stable").to_csv(
        path, index=False
    )


def published(folder: Path = PUBLISHED) -> Studies:
    """The studies that a folder holds; none before the first."""
    outcomes = {
        seed: pd.read_csv(folder / f"{seed}.csv.gz")
        for seed in SEEDS
        if (folder / f"{seed}.csv.gz").exists()
    }
    if not outcomes:
        return Studies({}, pd.DataFrame(), pd.DataFrame())
    return Studies(
        outcomes,
        pd.read_csv(folder / "verdicts.csv", index_col="seed"),
        pd.read_csv(folder / "regions.csv"),
    )


def timed_minutes(*several: Studies) -> list[float]:
    """Of all timed runs."""
    return [
        float(value)
        for studies in several
        if len(studies.verdicts)
        for value in studies.verdicts["minutes"].dropna()
    ]


def answer(studies: Studies, timed: Sequence[float]) -> str:
    """How many studies show an improvement, and a row for each. timed: minutes of all timed runs."""
    pieces, verdicts = studies.outcomes, studies.verdicts
    if not pieces:
        return "No study is published."
    better = {
        name: sum(p_value(piece, name) <= ALPHA for piece in pieces.values())
        for name in ("base", "control")
    }
    counts = [failures(piece) for piece in pieces.values()]
    ahead = mean_difference([count["adaptive"] - count["random"] for count in counts])
    head = (
        f"{len(pieces)} of {len(SEEDS)} studies are published. Version `adaptive` fails significantly less than the base "
        f"in {better['base']} of them, and less than `control` in {better['control']}. Failures of `adaptive` "
        f"minus those of `random`: {ahead}."
    )
    if len(counts) > 1:
        head += f" Without seed {next(iter(pieces))}: {mean_difference([count['adaptive'] - count['random'] for count in counts[1:]])}."
    if timed:
        head += f" A study takes {np.median(timed):.1f} minutes (median of {len(timed)} timed runs, {min(timed):.1f} to {max(timed):.1f})."
    lines = [
        fill(head, LINE),
        "",
        "| seed | tests | base | `control` | `random` | `adaptive` | p, against base | p, against `control` | champion | minutes |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for (seed, piece), count in zip(pieces.items(), counts, strict=True):
        counted = " | ".join(
            str(number) for number in (seed, len(valid(piece)), *(count[name] for name in VERSIONS))
        )
        spent = verdicts.loc[seed, "minutes"]
        took = "not timed" if np.isnan(spent) else f"{spent:.1f}"
        p_values = f"{p_text(p_value(piece, 'base'))} | {p_text(p_value(piece, 'control'))}"
        lines.append(f"| {counted} | {p_values} | `{verdicts.loc[seed, 'champion']}` | {took} |")
    return "\n".join([*lines, "", *_largest(studies)])


def _largest(studies: Studies) -> list[str]:
    """What the largest failure region of each seed is about, and whether its sentence names a planted group."""
    rows, named = [], 0
    for seed in studies.outcomes:
        found = _regions(studies, seed)
        if found.empty:
            rows.append(f"| {seed} | 0 | none | – | – | – |")
            continue
        largest = found.iloc[0]
        text = subject(stored(largest["conditions"]))
        named += any(group in text.lower() for group in PLANTED)
        counts = " | ".join(
            str(largest[name]) for name in ("failures", "tests_inside", "failures_inside")
        )
        rows.append(f"| {seed} | {len(found)} | {text} | {counts} |")
    head = f"The largest region's sentence names a planted group, children or crouching people, in {named} of {len(rows)} searches."
    return [
        fill(head, LINE),
        "",
        "| seed | regions | the largest, in words | failures in it | tests inside its rule | of them, failures |",
        "|---|---|---|---|---|---|",
        *rows,
    ]


def repeated(studies: Studies, again: Studies) -> list[str]:
    """How the outcomes of a seed differ between two executions."""
    lines = []
    for seed, piece in again.outcomes.items():
        first, same = studies.outcomes[seed], _regions(studies, seed).equals(_regions(again, seed))
        counts, different = (
            (failures(first), failures(piece)),
            first[VERSIONS].ne(piece[VERSIONS]).sum(),
        )
        spent = again.verdicts.loc[seed, "minutes"]
        took = "" if np.isnan(spent) else f", in {spent:.1f} minutes"
        lines += [
            "",
            f"Seed {seed} once more{took}. The searches found {'the same' if same else 'other'} failure regions.",
            "",
            f"| version | failures | once more | of {len(piece)} outcomes, different |",
            "|---|---|---|---|",
            *(
                f"| `{name}` | {counts[0][name]} | {counts[1][name]} | {different[name]} |"
                for name in VERSIONS
            ),
        ]
    return lines


def _regions(studies: Studies, seed: int) -> pd.DataFrame:
    return studies.regions[studies.regions["seed"] == seed].reset_index(drop=True)


def stored(conditions: str) -> list[RuleCondition]:
    """The conditions of a published rule."""
    return [RuleCondition.model_validate(condition) for condition in json.loads(conditions)]


def p_value(piece: pd.DataFrame, against: str) -> float:
    """Exact McNemar test that `adaptive` fails less than another version; 1 if it fails as often or more."""
    failed = valid(piece)
    pair = mcnemar(failed[against], failed["adaptive"])
    return pair.p_value if pair.fixes > pair.regressions else 1.0


if __name__ == "__main__":
    main()
