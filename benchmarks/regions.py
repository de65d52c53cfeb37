"""Are planted failure regions found again?

    python -m benchmarks.regions run [--seeds 5] [--random 20]    writes docs/results/regions.csv
    python -m benchmarks.regions show                             the tables of the page

In each world of `tests/planted.py`, random tests are drawn with each seed and grouped. A planted
region counts as found if a rule overlaps it by at least 0.7 (intersection over union). Then come
worlds whose labels are drawn at random: how many have a region at all, and in how many 20 fresh
tests inside and 20 just outside confirm one.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd

from benchmarks.shared import RESULTS, markdown
from pipeline.core.confirmation import confirmed, draw_inside, draw_just_outside
from pipeline.core.counted import Counted
from pipeline.core.grouping import Group, Outcomes, group_failures, held_back
from pipeline.core.rules import Bools
from pipeline.progress import Progress
from pipeline.scenarios.people import WORDS
from tests.planted import SPACE, WORLDS, World

PUBLISHED = RESULTS / "regions.csv"
NEIGHBOURS, MIN_FAILURES = 0.5, 4
SAME = 0.7
FRESH = 20
RANDOM_TESTS, RANDOM_RATES = 400, (0.05, 0.15, 0.3)
MEASURES = ("overlap", "others", "isolated", "precision", "held back", "fresh", "between seeds")
"""The columns of a world after its name, tests, seeds and the seeds in which all are found."""


def main() -> None:
    """Measure and publish, or print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("action", choices=["run", "show"])
    parser.add_argument("--seeds", type=int, default=5, help="seeds of each world")
    parser.add_argument("--random", type=int, default=20, help="random worlds by failure rate")
    options = parser.parse_args()
    if options.action == "show":
        print(shown(pd.read_csv(PUBLISHED)))
        return
    rows: list[dict[str, object]] = []
    with Progress("regions") as progress:
        for name, world in WORLDS.items():
            complete, means = scored(world, options.seeds)
            row = {"world": name, "tests": world.tests, "seeds": options.seeds, "found": complete}
            rows.append({**row, **dict(zip(MEASURES, means, strict=True))})
            progress(len(rows), len(WORLDS) + len(RANDOM_RATES), name)
        for rate in RANDOM_RATES:
            claims = np.array([at_random(seed, rate) for seed in range(options.random)])
            regions, confirmations = claims.sum(axis=0)
            row = {"world": f"random, {rate:g}", "tests": RANDOM_TESTS, "seeds": options.random}
            rows.append({**row, "found": regions, "confirmed": confirmations})
            progress(len(rows), len(WORLDS) + len(RANDOM_RATES), f"random, {rate:g}")
    pd.DataFrame(rows).to_csv(PUBLISHED, index=False, float_format="%.4g")


def shown(table: pd.DataFrame) -> str:
    """The tables of the page."""
    planted, random = [], []
    for row in table.to_dict("records"):
        if str(row["world"]) in WORLDS:
            means = [f"{row[measure]:.2f}" for measure in MEASURES]
            seeds = f"{row['found']} / {row['seeds']}"
            planted.append([row["world"], row["tests"], seeds, *means])
        else:
            rate = str(row["world"]).removeprefix("random, ")
            random.append([rate, row["seeds"], row["found"], f"{row['confirmed']:.0f}"])
    names = ("failure rate at random", "worlds", "with a region", "with a confirmed region")
    head = markdown(("world", "tests", "found", *MEASURES), planted)
    return f"{head}\n\n{markdown(names, random)}"


def grouped(tests: Outcomes) -> list[Group]:
    """The groups of failures, as a study makes them."""
    causes = np.where(tests.failed, "box", "none")
    return group_failures(tests, causes, NEIGHBOURS, MIN_FAILURES)


def scored(world: World, seeds: int) -> tuple[int, list[float]]:
    """The seeds in which every planted region is found, and the means of `MEASURES`."""
    probes = SPACE.sample(20_000, np.random.default_rng(99))
    truth, fails = [box.holds(probes) for box in world.boxes], world.fails(probes)
    rows, covered, complete = [], [], 0
    for seed in range(seeds):
        tests = world.outcomes(seed)
        groups = grouped(tests)
        rules = [group.rule.holds(probes) for group in groups]
        overlaps = np.zeros((len(truth), 1 + len(rules)))  # The first column is of no rule.
        for i, box in enumerate(truth):
            overlaps[i, 1:] = [overlap(box, rule) for rule in rules]
        best = overlaps.max(axis=1)
        complete += bool(best.min() >= SAME)
        others = int((overlaps[:, 1:].max(axis=0) < SAME).sum())
        union = np.any([np.zeros(len(probes), bool), *rules], axis=0)
        covered.append(union)
        members = [np.zeros(len(tests.failed), bool), *(group.members for group in groups)]
        isolated = (tests.failed & ~np.any(members, axis=0)).sum() / tests.failed.sum()
        fresh = fails[union].mean() if union.any() else np.nan
        rows.append([best.mean(), others, isolated, *precisions(tests, groups), fresh])
    means = np.nanmean(np.array(rows, float), axis=0)
    agreement = np.mean([overlap(a, b) for a, b in combinations(covered, 2)])
    return complete, [*means.tolist(), float(agreement)]


def precisions(tests: Outcomes, groups: Sequence[Group]) -> tuple[float, float]:
    """Share of failures inside the rules: in their own tests, and in tests held back."""
    if not groups:
        return np.nan, np.nan
    trained, held = np.zeros(2), np.zeros(2)
    for group in groups:
        inside = group.rule.holds(tests.points)
        trained += (tests.failed & inside).sum(), inside.sum()
        held += held_back(tests, group)  # Tests, then failures.
    return trained[0] / max(1, trained[1]), held[1] / max(1, held[0])


def overlap(first: Bools, second: Bools) -> float:
    """Intersection over union of two sets of points; 1 for two empty ones."""
    union = int((first | second).sum())
    return float((first & second).sum() / union) if union else 1.0


def at_random(seed: int, failure_rate: float) -> tuple[bool, bool]:
    """Whether labels at random have a region, and whether fresh labels at random confirm one."""
    rng = np.random.default_rng([seed, round(1000 * failure_rate)])
    points = SPACE.sample(RANDOM_TESTS, rng)
    groups = grouped(Outcomes(SPACE, points, rng.random(RANDOM_TESTS) < failure_rate, WORDS))
    counts = []
    for group in groups:
        drawn = (
            draw_inside(SPACE, group.rule, FRESH, rng),
            draw_just_outside(SPACE, group.rule, FRESH, rng),
        )
        inside, outside = (Counted.of(rng.random(len(fresh)) < failure_rate) for fresh in drawn)
        counts.append((inside, outside))
    return bool(groups), any(confirmed(counts, 0.05))


if __name__ == "__main__":
    main()
