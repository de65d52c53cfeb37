"""The fewest points that complete k-projection coverage: the paper's domain, and random domains against an exhaustive search.

    python benchmarks/completion.py [--cases 300]

Random domains: 2 to 4 conditions of 2 to 4 values, k from 1 to 3, with and without weights, constraints and given points. The search is
written from the definitions.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, product
from math import prod

import numpy as np

from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage.completion import Completion
from pipeline.core.coverage.projection import Combine, Demand
from pipeline.core.coverage.proposals import Proposer

Point = tuple[int, ...]
Cell = tuple[Point, Point]
"""The variables of a plane, and their categories."""
MOST_POINTS = 60
"""Feasible points of a domain, so that the exhaustive search ends."""


@dataclass(frozen=True)
class Case:
    """A domain as plain lists. given: points that are there already. points: all feasible ones."""

    demand: Demand
    given: list[Point]
    points: list[Point]

    @property
    def completion(self) -> Completion:
        """What the product finds."""
        return Proposer(self.demand).completion(
            np.array(self.given, np.int64).reshape(-1, len(self.demand.sizes))
        )

    def missing(self) -> dict[Cell, int]:
        """Points that each cell still wants."""
        counted = Counter(cell for point in self.given for cell in self.cells(point))
        wanted = {
            cell: self._weight(cell) - counted[cell]
            for point in self.points
            for cell in self.cells(point)
        }
        return {cell: number for cell, number in wanted.items() if number > 0}

    def cells(self, point: Point) -> list[Cell]:
        """The cells that a point lies in."""
        planes = combinations(range(len(point)), self.demand.k)
        return [(plane, tuple(point[variable] for variable in plane)) for plane in planes]

    def completes(self, added: list[Point]) -> bool:
        """Whether the points are feasible and leave nothing missing."""
        counted = Counter(cell for point in added for cell in self.cells(point))
        return set(added) <= set(self.points) and all(
            counted[cell] >= number for cell, number in self.missing().items()
        )

    def _weight(self, cell: Cell) -> int:
        weights = [
            self.demand.weight_arrays()[variable][category]
            for variable, category in zip(*cell, strict=True)
        ]
        if self.demand.combine == "product":
            return int(prod(weights))
        return int(sum(weights) if self.demand.combine == "sum" else max(weights))


def random_case(seed: int) -> Case:
    """A domain in which something is missing."""
    rng = np.random.default_rng(seed)
    while True:
        sizes = tuple(rng.integers(2, 5, rng.integers(2, 5)).tolist())
        clauses = tuple(_random_clause(sizes, rng) for _ in range(rng.integers(4)))
        points = [
            point
            for point in product(*map(range, sizes))
            if all(_holds(clause, point) for clause in clauses)
        ]
        if not 0 < len(points) <= MOST_POINTS:
            continue
        weights = [rng.integers(0, 3, size) for size in sizes] if rng.random() < 0.5 else None
        combine: Combine = ("product", "sum", "max")[rng.integers(3)]
        demand = Demand(
            Constraints(sizes, clauses),
            int(rng.integers(1, min(3, len(sizes)) + 1)),
            weights,
            combine,
        )
        case = Case(
            demand, [points[i] for i in rng.integers(len(points), size=rng.integers(6))], points
        )
        if case.missing():
            return case


def _random_clause(sizes: tuple[int, ...], rng: np.random.Generator) -> tuple[Literal, ...]:
    variables = rng.choice(
        len(sizes), min(len(sizes), int(rng.integers(1, 4))), replace=False
    ).tolist()
    return tuple(
        Literal(variable, int(rng.integers(sizes[variable])), bool(rng.random() < 0.5))
        for variable in variables
    )


def _holds(clause: tuple[Literal, ...], point: Point) -> bool:
    return any((point[literal.variable] == literal.category) == literal.equal for literal in clause)


def can_complete(case: Case, missing: Mapping[Cell, int], count: int, failed: set[object]) -> bool:
    """Whether `count` points meet what is missing, by trying every point for the cell with the fewest; failed: what is known not to."""
    if not missing:
        return True
    planes: Counter[Point] = Counter()
    for (plane, _), number in missing.items():
        planes[plane] += number
    state = (count, frozenset(missing.items()))
    if max(planes.values()) > count or state in failed:
        return False
    helps = {
        frozenset(cell for cell in case.cells(point) if cell in missing) for point in case.points
    }
    choices = [cells for cells in helps if not any(cells < others for others in helps)]
    scarce = min(missing, key=lambda cell: (sum(cell in cells for cells in choices), cell))
    for cells in choices:
        if scarce in cells:
            left = {cell: number - (cell in cells) for cell, number in missing.items()}
            if can_complete(
                case, {cell: number for cell, number in left.items() if number}, count - 1, failed
            ):
                return True
    failed.add(state)
    return False


def is_optimal(case: Case, found: Completion) -> bool:
    """Whether the points complete the coverage, one point fewer cannot, and the product says so."""
    added: list[Point] = [tuple(row) for row in found.categories.tolist()]
    return (
        found.smallest
        and case.completes(added)
        and not can_complete(case, case.missing(), len(added) - 1, set())
    )


def named() -> None:
    """Print the completions of the paper's domain (section 5) and of six conditions of three values."""
    linked, free = (
        Constraints((3, 2, 2, 2, 2, 2), ((Literal(2, 1), Literal(3, 0)),)),
        Constraints((3,) * 6),
    )
    # E1 to E5 of Table 1, which leaves E5 open: it is assumed to equal E3.
    known = np.array(
        [
            [2, 0, 1, 0, 1, 0],
            [2, 1, 1, 0, 1, 0],
            [2, 1, 0, 0, 0, 1],
            [2, 1, 1, 0, 1, 1],
            [2, 1, 0, 0, 0, 1],
        ]
    )
    nothing = known[:0]
    cases = (
        ("paper", linked, known, 2),
        ("paper", linked, nothing, 2),
        ("paper", linked, nothing, 3),
        ("3^6", free, nothing, 2),
    )
    for name, limits, given, k in cases:
        before = time.process_time()
        found = Proposer(Demand(limits, k)).completion(given)
        spent = time.process_time() - before
        size = f"{len(found.categories)} more, at least {found.bound}"
        print(f"{name}, k = {k}, {len(given)} points there: {size}; {spent:.1f} s", flush=True)


def main() -> None:
    """Print the named domains and how many random cases are optimal and certified."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=300, help="how many (default: %(default)s)")
    cases = parser.parse_args().cases
    named()
    right, slowest, begun = 0, 0.0, time.process_time()
    for seed in range(cases):
        case, before = random_case(seed), time.process_time()
        found = case.completion
        slowest = max(slowest, time.process_time() - before)
        if is_optimal(case, found):
            right += 1
        else:
            print(f"case {seed}: {len(found.categories)} points, bound {found.bound}")
    spent = time.process_time() - begun
    print(
        f"{right} of {cases} optimal and certified; a completion takes at most {slowest:.2f} s of one core, all {spent:.0f} s"
    )


if __name__ == "__main__":
    main()
