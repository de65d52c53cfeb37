"""Does the default study end in a shown improvement? Ten studies, each with a seed of its own.

    python -m benchmarks.default_study run 0 1 2        execute and publish; 15 minutes a seed
    python -m benchmarks.default_study run 0 --again    publish a second execution of seed 0
    python -m benchmarks.default_study run 2 --again --ship    and fill models/published
    python -m benchmarks.default_study check            compare a finished `study=published`
    python -m benchmarks.default_study answer           the tables of docs/results/default.md
    python -m benchmarks.default_study headline         README's sentences

A study runs from a fresh clone to the verdict. Its seed chooses the search, the retraining and the
held-out tests. A killed run is resumed, but no longer timed; `--busy` records no time either.
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

from benchmarks.shared import (
    RESULTS,
    TEST,
    failures,
    markdown,
    mean_difference,
    of_study,
    p_text,
    valid,
    write,
)
from pipeline.analysis.region_sentence import subject
from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.region_results import FailureRegions, RuleCondition
from pipeline.artefacts.results import read
from pipeline.config.composing import PARAMS, compose, load
from pipeline.core.lineage import VERSION_FILES
from pipeline.core.statistics import mcnemar, mean_interval

PUBLISHED = RESULTS / "default"
AGAIN = PUBLISHED / "again"
CLONES = Path(".cache/default_study")
EXECUTED = Path(".cache/executed_for")
"""In a finished clone, the folder that publishes it."""
SHIPPED = Path("models/published")
SHIPPED_VERSIONS = ("random", "adaptive")
SEEDS = range(10)
VERSIONS = ["base", "control", "random", "adaptive"]
ALPHA = 0.05
REGION = ["seed", "scenario", "cause", "failures", "tests_inside", "failures_inside", "conditions"]
PLANTED = ("children", "crouching")
LINE = 118
"""Length of a line of prose."""


@dataclass(frozen=True)
class Studies:
    """Published studies.

    outcomes: by seed. verdicts: champion and minutes by seed. regions: the largest of each seed
    first, with the columns `REGION`.
    """

    outcomes: Mapping[int, pd.DataFrame]
    verdicts: pd.DataFrame
    regions: pd.DataFrame

    @property
    def minutes(self) -> list[float]:
        """Minutes of the timed studies."""
        return self.verdicts["minutes"].dropna().tolist() if len(self.verdicts) else []

    def regions_of(self, seed: int) -> pd.DataFrame:
        """The regions of a seed, the largest first."""
        return self.regions[self.regions["seed"] == seed].reset_index(drop=True)


def main() -> None:
    """Execute, compare or answer."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    execute = commands.add_parser("run")
    execute.add_argument("seed", type=int, nargs="+", choices=list(SEEDS))
    execute.add_argument("--busy", action="store_true", help="record no time")
    execute.add_argument("--again", action="store_true", help=f"publish in {AGAIN}")
    execute.add_argument("--ship", action="store_true", help=f"put the versions into {SHIPPED}")
    execute.add_argument("--keep", action="store_true", help=f"leave the clone in {CLONES}")
    for name in ("check", "answer", "headline"):
        commands.add_parser(name)
    options = parser.parse_args()
    if options.command == "check":
        config = compose("published", [])
        print(check(of_study(config), pd.read_csv(AGAIN / f"{config.comparison.seed}.csv.gz")))
    elif options.command == "answer":
        studies, again = published(), published(AGAIN)
        parts = [answer(studies, studies.minutes + again.minutes), repeated(studies, again)]
        print("\n\n".join(parts))
    elif options.command == "headline":
        studies = published()
        print(headline(studies, studies.minutes + published(AGAIN).minutes))
    else:
        for seed in options.seed:
            clone = run(seed, not options.busy, AGAIN if options.again else PUBLISHED)
            if options.ship:
                ship(clone)
            if not options.keep:
                shutil.rmtree(clone)


def run(seed: int, timed: bool, folder: Path) -> Path:
    """Execute a default study in a clone of HEAD, publish it in a folder, return the clone."""
    clone = CLONES / str(seed)
    check_clone(clone, folder)
    timed &= not clone.exists()
    begin = time.monotonic()
    if not clone.exists():
        subprocess.run(["git", "clone", "--quiet", ".", clone], check=True)
    settings = f"seeds=[{seed}] retraining.seeds=[{seed}] comparison.seed={seed}"
    study = f".venv/bin/python -m pipeline compose study=default {settings}"
    subprocess.run(["bash", "-c", f"./run setup && {study} && ./run"], cwd=clone, check=True)
    minutes = (time.monotonic() - begin) / 60 if timed else np.nan
    publish(clone, seed, minutes, folder)
    (clone / EXECUTED).write_text(str(folder))
    return clone


def check_clone(clone: Path, folder: Path) -> None:
    """Raise SystemExit for a clone in which `./run` would not make the study of the folder."""
    if not clone.exists():
        return
    command = ["git", "rev-parse", "HEAD"]
    heads = []
    for place in (clone, "."):
        heads.append(subprocess.run(command, cwd=place, check=True, capture_output=True).stdout)
    remedy = "delete it to execute the study once more"
    if heads[0] != heads[1]:
        raise SystemExit(f"{clone} is a clone of another commit; {remedy}")
    executed = clone / EXECUTED
    if executed.exists() and executed.read_text() != str(folder):
        raise SystemExit(
            f"{clone} is the execution that {executed.read_text()} publishes; {remedy}"
        )


def publish(clone: Path, seed: int, minutes: float, folder: Path) -> None:
    """Publish the outcomes, the verdict and the failure regions of a finished study."""
    folder.mkdir(parents=True, exist_ok=True)
    outcomes = of_study(load(clone / PARAMS), clone)
    champion = read(clone / "data/default/comparison.json", Comparison).champion
    row = {"seed": seed, "champion": champion, "minutes": round(minutes, 1)}
    verdicts = replaced(folder / "verdicts.csv", seed, pd.DataFrame([row]))
    verdicts.sort_values("seed").to_csv(folder / "verdicts.csv", index=False)
    regions = replaced(folder / "regions.csv", seed, regions_in(clone / "data/default", seed))
    regions = regions.sort_values(["seed", "failures"], ascending=[True, False], kind="stable")
    regions.to_csv(folder / "regions.csv", index=False)
    write(outcomes, folder / f"{seed}.csv.gz")  # Last: a seed with outcomes is published.


def replaced(path: Path, seed: int, rows: pd.DataFrame) -> pd.DataFrame:
    """A published table with new rows of a seed."""
    if not path.exists():
        return rows
    earlier = pd.read_csv(path)
    return pd.concat([earlier[earlier["seed"] != seed], rows])


def regions_in(study: Path, seed: int) -> pd.DataFrame:
    """The failure regions of the base detector in a study's folder."""
    rows = []
    for path in sorted((study / "regions/base").glob("*.json")):
        regions = read(path, FailureRegions)
        for region in regions.regions:
            row = {"seed": seed, "scenario": regions.scenario, "cause": region.cause}
            row |= {"failures": len(region.members), "tests_inside": region.support}
            row["failures_inside"] = region.failures_inside
            row["conditions"] = json.dumps([each.model_dump() for each in region.conditions])
            rows.append(row)
    return pd.DataFrame(rows, columns=REGION)


def ship(clone: Path) -> None:
    """Copy the weights, cards and curves of a finished study's retrained versions."""
    folders = Folders(load(clone / PARAMS))
    for version in SHIPPED_VERSIONS:
        target = SHIPPED / version
        target.mkdir(parents=True, exist_ok=True)
        for kind in ("weights", "card", "curve"):
            name = VERSION_FILES[kind]
            shutil.copyfile(clone / folders.model(version, name), target / name)


def check(here: pd.DataFrame, there: pd.DataFrame) -> str:
    """How the outcomes of the shipped versions, executed here, differ from the published ones."""
    if not here[TEST].equals(there[TEST]):
        raise SystemExit(
            "expected the published held-out tests, got others; "
            "compose study=published without changes"
        )
    rows = []
    for name in ("base", *SHIPPED_VERSIONS):
        different = here[name].ne(there[name]).sum()
        rows.append((f"`{name}`", failures(here)[name], failures(there)[name], different))
    return markdown(
        ("version", "failures", "published", f"of {len(here)} outcomes, different"), rows
    )


def published(folder: Path = PUBLISHED) -> Studies:
    """The studies that a folder holds."""
    outcomes = {}
    for seed in SEEDS:
        if (folder / f"{seed}.csv.gz").exists():
            outcomes[seed] = pd.read_csv(folder / f"{seed}.csv.gz")
    if not outcomes:
        return Studies({}, pd.DataFrame(), pd.DataFrame())
    verdicts = pd.read_csv(folder / "verdicts.csv", index_col="seed")
    return Studies(outcomes, verdicts, pd.read_csv(folder / "regions.csv"))


def improved(studies: Studies, version: str) -> int:
    """Number of studies in which `adaptive` fails significantly less than another version."""
    return sum(p_value(table, version) <= ALPHA for table in studies.outcomes.values())


def p_value(outcomes: pd.DataFrame, version: str) -> float:
    """Exact McNemar test that `adaptive` fails less than a version; 1 if it does not."""
    failed = valid(outcomes)
    pair = mcnemar(failed[version], failed["adaptive"])
    return pair.p_value if pair.fixes > pair.regressions else 1.0


def ahead(studies: Studies) -> list[int]:
    """Failures of `adaptive` minus those of `random` in each study."""
    counts = [failures(table) for table in studies.outcomes.values()]
    return [count["adaptive"] - count["random"] for count in counts]


def answer(studies: Studies, minutes: Sequence[float]) -> str:
    """How many studies show an improvement, and a row for each. minutes: of all timed runs."""
    if not studies.outcomes:
        return "No study is published."
    differences = ahead(studies)
    head = (
        f"{len(differences)} of {len(SEEDS)} studies are published. `adaptive` fails significantly "
        f"less than the base in {improved(studies, 'base')} of them, and less than `control` in "
        f"{improved(studies, 'control')}. Failures of `adaptive` minus those of `random`: "
        f"{mean_difference(differences)}."
    )
    if len(differences) > 1:
        first = next(iter(studies.outcomes))
        head += f" Without seed {first}: {mean_difference(differences[1:])}."
    if minutes:
        head += (
            f" A study takes {np.median(minutes):.1f} minutes (median of {len(minutes)} timed "
            f"runs, {min(minutes):.1f} to {max(minutes):.1f})."
        )
    names = ["seed", "tests", "base", *(f"`{name}`" for name in VERSIONS[1:])]
    names += ["p, against base", "p, against `control`", "champion", "minutes"]
    rows = []
    for seed, table in studies.outcomes.items():
        counts, verdict = failures(table), studies.verdicts.loc[seed]
        row: list[object] = [seed, len(valid(table)), *(counts[name] for name in VERSIONS)]
        row += [p_text(p_value(table, name)) for name in ("base", "control")]
        row += [f"`{verdict['champion']}`", minutes_text(verdict["minutes"])]
        rows.append(row)
    return "\n\n".join([fill(head, LINE), markdown(names, rows), largest(studies)])


def minutes_text(minutes: float) -> str:
    """The minutes of a study in a table."""
    return "not timed" if np.isnan(minutes) else f"{minutes:.1f}"


def largest(studies: Studies) -> str:
    """The largest failure region of each seed, and how many name a planted group."""
    rows: list[list[object]] = []
    named = 0
    for seed in studies.outcomes:
        regions = studies.regions_of(seed)
        if regions.empty:
            rows.append([seed, 0, "none", "–"])
            continue
        region = regions.iloc[0]
        text = subject([RuleCondition.model_validate(c) for c in json.loads(region["conditions"])])
        named += any(group in text.lower() for group in PLANTED)
        rows.append([seed, len(regions), text, region["failures"]])
    head = (
        "The largest region's sentence names a planted group, children or crouching people, in "
        f"{named} of {len(rows)} searches."
    )
    names = ["seed", "regions", "the largest, in words", "failures in it"]
    return f"{fill(head, LINE)}\n\n{markdown(names, rows)}"


def repeated(studies: Studies, again: Studies) -> str:
    """How the outcomes of a seed differ between two executions."""
    rows = []
    for seed, table in again.outcomes.items():
        first = studies.outcomes[seed]
        same = studies.regions_of(seed).equals(again.regions_of(seed))
        row = [seed, minutes_text(again.verdicts.loc[seed, "minutes"]), "same" if same else "other"]
        rows.append([*row, *(table[name].ne(first[name]).sum() for name in VERSIONS)])
    head = "A second execution: how many outcomes of each version differ from the first one."
    names = ["seed", "minutes", "regions", "base", *(f"`{name}`" for name in VERSIONS[1:])]
    return f"{head}\n\n{markdown(names, rows)}"


def headline(studies: Studies, minutes: Sequence[float]) -> str:
    """README's sentences; SystemExit if they do not follow from the outcomes."""
    if mean_interval(ahead(studies))[1] < 0:
        raise SystemExit("headline: `adaptive` fails less than `random`; write another sentence")
    counts = pd.DataFrame([failures(table) for table in studies.outcomes.values()]).mean()
    tests = len(valid(next(iter(studies.outcomes.values()))))
    text = (
        f"In {improved(studies, 'base')} of {len(studies.outcomes)} [default studies]"
        "(docs/results/default.md), `adaptive` fails significantly less than the base, within "
        f"{min(minutes):.0f} to {max(minutes):.0f} minutes. On average, the base fails "
        f"{counts['base']:.1f} of {tests} held-out tests, `adaptive` {counts['adaptive']:.1f}, "
        f"`random` {counts['random']:.1f}. That the search teaches more than random tests is not "
        "shown."
    )
    return fill(text, LINE, break_long_words=False, break_on_hyphens=False)


if __name__ == "__main__":
    main()
