"""Does the interval that fresh tests give a rule's failure rate hold? Rendered, for the regions of the default studies.

    python benchmarks/confirmed_rules.py run 0 1 2     execute the fresh tests of these seeds' rules; half a minute a rule on two cores
    python benchmarks/confirmed_rules.py answer        the table of docs/results/regions.md

The rules are those in docs/results/default/regions.csv, the detector is the base in data/default, which `./run base` makes. `STATED`
tests inside a rule give the interval, as `regions.confirm` does; `CHECKS` others give the rate that ought to lie in it.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
import pandas as pd
from default_study import LINE, stored

from pipeline.analysis.region_sentence import subject
from pipeline.analysis.stored_rules import stored_rule
from pipeline.config.composing import compose, functional_scenario
from pipeline.core.confirmation import draw_inside
from pipeline.core.counted import Counted
from pipeline.execution.confirming import counted
from pipeline.execution.points import Executor
from pipeline.execution.workers import Setup
from pipeline.progress import Progress

RULES = Path("docs/results/default/regions.csv")
PUBLISHED = Path("docs/results/default/confirmed.csv")
MODEL = Path("data/default/models/base/model.onnx")
JOURNALS = Path(".cache/confirmed_rules")
STATED, CHECKS = 20, 80
CONFIDENCE = 0.95


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    execute = commands.add_parser("run")
    execute.add_argument("seed", type=int, nargs="+")
    execute.add_argument("--workers", type=int, default=2)
    commands.add_parser("answer")
    options = parser.parse_args()
    rules = pd.read_csv(RULES)
    if options.command == "answer":
        print(
            answer(rules, pd.read_csv(PUBLISHED))
            if PUBLISHED.exists()
            else "No rule is checked yet."
        )
        return
    for seed in options.seed:
        publish(seed, list(run(distinct(rules[rules["seed"] == seed]), options.workers)))
        for folder in JOURNALS.glob(f"{seed}-*"):
            shutil.rmtree(folder)


def distinct(rules: pd.DataFrame) -> pd.DataFrame:
    """Without the rules that a region of another cause has, too; numbered as in the file, from 0 for each seed."""
    numbered = rules.assign(number=rules.groupby("seed").cumcount())
    return numbered.drop_duplicates(["seed", "scenario", "conditions"])


def run(rules: pd.DataFrame, workers: int) -> Iterator[dict[str, object]]:
    """Execute the fresh tests of a seed's rules: a row for each rule. A killed call resumes."""
    config = compose("default", [])
    for rule in rules.itertuples():
        described = functional_scenario(rule.scenario)
        space, name = described.logical_space(), f"{rule.seed} {rule.scenario} {rule.conditions}"
        rng = np.random.default_rng(
            int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
        )
        points = [
            space.decode(point)
            for point in draw_inside(
                space, stored_rule(space, stored(rule.conditions)), STATED + CHECKS, rng
            )
        ]
        setup = Setup(
            config.simulator, described, config.detector, MODEL, config.car, config.limits
        )
        folder = JOURNALS / f"{rule.seed}-{rule.number}"
        with Progress(f"seed {rule.seed}, rule {rule.number}") as progress:
            outcomes = Executor(setup, folder, workers, progress).outcomes(points)
        stated, checks = (
            counted(part, config.campaign.failure_threshold_s)
            for part in (outcomes[:STATED], outcomes[STATED:])
        )
        counts = {"stated_tests": stated.tests, "stated_failures": stated.failures}
        checked = {"check_tests": checks.tests, "check_failures": checks.failures}
        yield {
            "seed": rule.seed,
            "scenario": rule.scenario,
            "conditions": rule.conditions,
            **counts,
            **checked,
        }


def publish(seed: int, rows: Sequence[dict[str, object]], path: Path = PUBLISHED) -> None:
    made = pd.DataFrame(rows)
    if path.exists():
        earlier = pd.read_csv(path)
        made = pd.concat([earlier[earlier["seed"] != seed], made])
    made.sort_values("seed", kind="stable").to_csv(path, index=False)


def answer(rules: pd.DataFrame, outcomes: pd.DataFrame) -> str:
    """Every rule with its stated interval and the rate of the other tests, and in how many it lies inside.

    SystemExit for outcomes of a rule that is published no more.
    """
    lines, held, within = [], 0, 0
    both = distinct(rules).merge(outcomes, on=["seed", "scenario", "conditions"])
    if len(both) < len(outcomes):
        raise SystemExit(
            f"{PUBLISHED}: {len(outcomes) - len(both)} of {len(outcomes)} rules are not in {RULES}; run these seeds again"
        )
    for rule in both.itertuples():
        stated = Counted(rule.stated_tests, rule.stated_failures)
        low, high = stated.interval(CONFIDENCE)
        rate, precision = (
            rule.check_failures / rule.check_tests,
            rule.failures_inside / rule.tests_inside,
        )
        holds = low <= rate <= high
        held, within = held + holds, within + (low <= precision <= high)
        cells = (
            rule.seed,
            rule.scenario,
            subject(stored(rule.conditions)),
            f"{precision:.0%}",
            f"{low:.0%} to {high:.0%}",
            f"{rate:.0%}",
        )
        lines.append(f"| {' | '.join(map(str, cells))} | {'yes' if holds else 'no'} |")
    head = (
        f"The rate of {CHECKS} other tests lies in the stated interval for {held} of {len(lines)} rules. "
        f"The precision in the search's own tests lies in it for {within}."
    )
    return "\n".join(
        [
            fill(head, LINE),
            "",
            "| seed | scenario | rule, in words | precision in the search | stated, of fresh tests | other tests | inside |",
            "|---|---|---|---|---|---|---|",
            *lines,
        ]
    )


if __name__ == "__main__":
    main()
