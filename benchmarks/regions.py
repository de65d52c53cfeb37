"""Are planted failure regions found, named and found again? `python -m benchmarks.regions [--seeds 10]`.

In each world of `tests/planted.py`, random tests are drawn with each seed and grouped. Prints, as Markdown, for each world: seeds in which
every planted box has a region that overlaps it by at least 0.7 (intersection over union); the mean overlap; the regions that overlap
none; the failures in no region; the precision of the rules in the tests that made them, in held-back tests and in fresh ones; and how
much the rules of two seeds agree: the overlap of the parts of the space that they cover. Last, worlds whose labels are drawn at random:
in how many there is a region at all, and in how many one is confirmed by 20 fresh tests inside and 20 just outside.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from pipeline.core.confirmation import confirmed, draw_inside, draw_just_outside
from pipeline.core.counted import Counted
from pipeline.core.grouping import Group, Outcomes, group_failures, held_back
from pipeline.core.rules import Bools
from pipeline.progress import Progress
from pipeline.scenarios.people import WORDS
from tests.planted import SPACE, WORLDS, World

NEIGHBOURS, MIN_FAILURES = 0.5, 4
SAME = 0.7
FRESH = 20
RANDOM_TESTS, RANDOM_RATES = 400, (0.05, 0.15, 0.3)
HEADER = (
    "world",
    "tests",
    "found",
    "overlap",
    "others",
    "isolated",
    "precision",
    "held back",
    "fresh",
    "between seeds",
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10, help="seeds of each world")
    parser.add_argument(
        "--random", type=int, default=20, help="seeds of labels at random, for each failure rate"
    )
    options = parser.parse_args()
    print(f"| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}")
    with Progress("regions") as progress:
        for done, (name, world) in enumerate(WORLDS.items(), 1):
            print(
                f"| {name} | {world.tests} | {' | '.join(scored(world, options.seeds))} |",
                flush=True,
            )
            progress(done, len(WORLDS), name)
    print(
        "\n| failure rate at random | worlds | with a region | with a confirmed region |\n|---|---|---|---|"
    )
    for rate in RANDOM_RATES:
        claims = [at_random(seed, rate) for seed in range(options.random)]
        print(
            f"| {rate:g} | {len(claims)} | {sum(any_region for any_region, _ in claims)} | {sum(claim for _, claim in claims)} |",
            flush=True,
        )


def grouped(tests: Outcomes) -> list[Group]:
    return group_failures(tests, np.where(tests.failed, "box", "none"), NEIGHBOURS, MIN_FAILURES)


def scored(world: World, seeds: int) -> Iterator[str]:
    """The cells of a world's row."""
    probes = SPACE.sample(20_000, np.random.default_rng(99))
    truth, fails = [box.holds(probes) for box in world.boxes], world.fails(probes)
    rows, covered, found = [], [], 0
    for seed in range(seeds):
        tests = world.outcomes(seed)
        groups = grouped(tests)
        rules = [group.rule.holds(probes) for group in groups]
        best = [max((overlap(box, rule) for rule in rules), default=0.0) for box in truth]
        union = np.any(rules, axis=0) if rules else np.zeros(len(probes), bool)
        covered.append(union)
        found += min(best) >= SAME
        isolated = tests.failed & ~np.any(
            [np.zeros(len(tests.failed), bool), *(group.members for group in groups)], axis=0
        )
        others = sum(max(overlap(box, rule) for box in truth) < SAME for rule in rules)
        rows.append(
            [
                np.mean(best),
                others,
                isolated.sum() / tests.failed.sum(),
                *precisions(tests, groups),
                rate(fails & union, union),
            ]
        )
    means = np.nanmean(np.array(rows, float), axis=0)
    agreement = np.mean([overlap(a, b) for a, b in combinations(covered, 2)])
    yield f"{found} / {seeds}"
    yield from (f"{mean:.2f}" for mean in (*means, agreement))


def precisions(tests: Outcomes, groups: Sequence[Group]) -> tuple[float, float]:
    """Share of failures inside the rules: in the tests that made them, and in tests held back."""
    inside = [group.rule.holds(tests.points) for group in groups]
    kept = [held_back(tests, group) for group in groups]
    own = sum(int((tests.failed & rows).sum()) for rows in inside) / max(
        1, sum(int(rows.sum()) for rows in inside)
    )
    return (
        (own, sum(hits for _, hits in kept) / max(1, sum(count for count, _ in kept)))
        if groups
        else (np.nan, np.nan)
    )


def overlap(first: Bools, second: Bools) -> float:
    """Intersection over union of two sets of points; 1 for two empty ones."""
    union = int((first | second).sum())
    return float((first & second).sum() / union) if union else 1.0


def rate(hits: Bools, inside: Bools) -> float:
    return float(hits.sum() / inside.sum()) if inside.any() else np.nan


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
