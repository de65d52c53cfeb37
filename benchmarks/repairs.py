"""Is a planted cause named as the first repair? `python -m benchmarks.repairs [--seeds 10]`.

In each world of `tests/planted.py`, and with the analytic simulator, random tests are drawn with each seed and grouped. Up to ten failures
of each region are executed with each single change. Prints, as Markdown, for each world: seeds; regions; regions whose first repair changes
nothing but what their planted cause is about; and the mean share of failures that the first repair, the best change of anything else, and
the control repair. With "noise", 4 % of all outcomes are turned round, those of changed tests too.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.core.grouping import Outcomes, group_failures
from pipeline.core.kpi import evaluate
from pipeline.core.rules import Bools
from pipeline.core.space import Floats
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.progress import Progress
from pipeline.scenarios.changes import CONTROL, Change, changes, ranked
from pipeline.scenarios.people import WORDS
from pipeline.simulators.analytic import PLANTED, AnalyticSimulator
from pipeline.testing import CAR
from tests.planted import FOG, RAIN, SPACE, WORLDS, Band, World
from tests.scenarios import scenario_with

NEIGHBOURS, MIN_FAILURES = 0.5, 4
TESTS, FAILURES, THRESHOLD_S = 400, 10, 0.1
HEADER = (
    "world",
    "seeds",
    "regions",
    "first repair is the cause",
    "it repairs",
    "best other",
    "control",
)


@dataclass(frozen=True)
class Case:
    """Something that fails in planted regions. outcomes: of random tests by seed. fails: whether points (n, d) fail, drawn anew each time.
    causes: for points (n, d), the names of the variables that the planted region of most of them is about."""

    name: str
    outcomes: Callable[[int], Outcomes]
    fails: Callable[[Floats, int], Bools]
    causes: Callable[[Floats], frozenset[str]]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10, help="seeds of each world")
    seeds: int = parser.parse_args().seeds
    print(f"| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}")
    cases = [*(of_world(name, world) for name, world in WORLDS.items()), of_simulator()]
    with Progress("repairs") as progress:
        for done, case in enumerate(cases, 1):
            found = [one for seed in range(seeds) for one in judged(case, seed)]
            first, *shares = np.mean(np.array(found, float), axis=0)
            cells = (
                case.name,
                str(seeds),
                str(len(found)),
                f"{round(first * len(found))} / {len(found)}",
                *(f"{s:.2f}" for s in shares),
            )
            print(f"| {' | '.join(cells)} |", flush=True)
            progress(done, len(cases), case.name)


def judged(case: Case, seed: int) -> Iterator[tuple[bool, float, float, float]]:
    """For each region: whether the first repair is about its cause alone; shares that it, the best other change and the control repair."""
    tests = case.outcomes(seed)
    for group in group_failures(
        tests, np.where(tests.failed, "box", "none"), NEIGHBOURS, MIN_FAILURES
    ):
        drawn = np.random.default_rng(seed).permutation(np.flatnonzero(group.members))[:FAILURES]
        causes = case.causes(tests.points[drawn])
        tried = [
            (change, repaired(case, tests.points[drawn], change, seed))
            for change in (*changes(tests, group.members), CONTROL)
        ]
        shares = {change.text: share for change, share in tried}
        first = ranked(tried)[0]
        others = [
            share for change, share in tried if change.values and not causes & set(change.values)
        ]
        yield set(first.values) <= causes, shares[first.text], max(others), shares[CONTROL.text]


def repaired(case: Case, points: Floats, change: Change, seed: int) -> float:
    """Share of the failures at points (n, d) that pass with a change."""
    changed = [change.of(SPACE.decode(point), SPACE) for point in points]
    return float(
        1
        - case.fails(
            np.array([SPACE.encode(one) for one in changed if one is not None]), seed
        ).mean()
    )


def of_world(name: str, world: World) -> Case:
    """A world whose failures a formula gives."""

    def fails(points: Floats, seed: int) -> Bools:
        turned = np.random.default_rng([seed, 1]).random(len(points)) < world.noise
        return np.asarray(world.fails(points) ^ turned)

    def causes(points: Floats) -> frozenset[str]:
        box = max(world.boxes, key=lambda one: int(one.holds(points).sum()))
        about = (
            (RAIN, FOG)
            if isinstance(box, Band)
            else tuple(condition.variable for condition in box.conditions)
        )
        return frozenset(SPACE.names[index] for index in about)

    return Case(f"{name}{', noise' if world.noise else ''}", world.outcomes, fails, causes)


def of_simulator() -> Case:
    """The analytic simulator with a detector that sees what is there."""
    simulator, detector = AnalyticSimulator(scenario_with(SPACE), CAR), VisiblePixelOracle()

    def fails(points: Floats, seed: int = 0) -> Bools:
        return np.array(
            [
                evaluate(simulator.execute(SPACE.decode(p), detector).signals, THRESHOLD_S).failure
                for p in points
            ]
        )

    def outcomes(seed: int) -> Outcomes:
        points = SPACE.sample(TESTS, np.random.default_rng(seed))
        return Outcomes(SPACE, points, fails(points), WORDS)

    def causes(points: Floats) -> frozenset[str]:
        planted = PLANTED[
            int(np.argmax(np.bincount(simulator.planted(points)[simulator.planted(points) >= 0])))
        ]
        return frozenset([*planted.intervals, *planted.values])

    return Case("the analytic simulator", outcomes, fails, causes)


if __name__ == "__main__":
    main()
