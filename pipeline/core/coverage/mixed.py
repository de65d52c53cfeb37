"""Mixed strength: named planes and single combinations in addition to every k variables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

from pipeline.core.constraints import Constraints

STRONGEST = 6
"""Most variables of a plane in a covering array, of named planes and of a single combination."""
Planes = Mapping[tuple[int, ...], frozenset[tuple[int, ...]] | None]
"""The variables of each plane, rising, and its cells that are wanted, None for all."""


@dataclass(frozen=True)
class NamedPlanes:
    """Every `strength` of the variables form a plane. variables: rising."""

    name: str
    variables: tuple[int, ...]
    strength: int


@dataclass(frozen=True)
class Combination:
    """One cell.

    variables: rising.
    categories: one of each variable.
    weight: points that are wanted in the cell, whatever its categories weigh.
    """

    variables: tuple[int, ...]
    categories: tuple[int, ...]
    weight: int = 1


@dataclass(frozen=True)
class Extras:
    """Wanted in addition to the planes of every k variables."""

    planes: tuple[NamedPlanes, ...] = ()
    combinations: tuple[Combination, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.planes or self.combinations)

    def of(self, k: int) -> Extras:
        """The combinations of k variables: they change weights in the planes of k variables."""
        chosen = [cell for cell in self.combinations if len(cell.variables) == k]
        return Extras(combinations=tuple(chosen))

    def weights(self) -> dict[tuple[int, ...], dict[tuple[int, ...], int]]:
        """The weights of single cells, by plane and cell."""
        weights: dict[tuple[int, ...], dict[tuple[int, ...], int]] = {}
        for cell in self.combinations:
            weights.setdefault(cell.variables, {})[cell.categories] = cell.weight
        return weights


NOTHING = Extras()


@dataclass(frozen=True)
class Mixed:
    """Every `strength` variables are combined, and the extras."""

    strength: int
    extras: Extras = NOTHING


def all_planes(count: int, mixed: Mixed) -> Planes:
    """The planes of `count` variables.

    First those of every `strength` variables, then the named ones, then those of which single cells
    are wanted.

    >>> list(all_planes(3, Mixed(2)))
    [(0, 1), (0, 2), (1, 2)]
    """
    whole = [*combinations(range(count), mixed.strength)]
    for named in mixed.extras.planes:
        whole += combinations(named.variables, named.strength)
    planes: dict[tuple[int, ...], frozenset[tuple[int, ...]] | None] = dict.fromkeys(whole)
    for plane, weights in mixed.extras.weights().items():
        planes.setdefault(plane, frozenset(weights))
    return planes


def copy_for(constraints: Constraints, planes: Planes) -> Constraints:
    """A copy of the constraints for one search.

    A copy, because a SAT solver's answers depend on earlier queries, and the same arguments must
    give the same rows. If planes have different sizes, it has one more variable of one category,
    which fills up the smaller planes.
    """
    several = len(set(map(len, planes))) > 1
    return Constraints(constraints.sizes + (1,) * several, constraints.clauses)


def filled_up(planes: Planes, idle: int) -> list[tuple[int, ...]]:
    """The planes, all as large as the largest. idle: the variable that fills them up."""
    most = max(map(len, planes))
    return [plane + (idle,) * (most - len(plane)) for plane in planes]
