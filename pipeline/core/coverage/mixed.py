"""Mixed strength: what coverage combines in addition to every k variables: named planes and single combinations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

from pipeline.core.constraints import Constraints

STRONGEST = 6
"""Most variables of a plane in a covering array, of named planes and of a single combination."""
Planes = Mapping[tuple[int, ...], frozenset[tuple[int, ...]] | None]
"""The variables of each plane, rising; and the cells of it that are wanted, None for all."""


@dataclass(frozen=True)
class NamedPlanes:
    """Every `strength` of the variables form a plane. variables: rising."""

    name: str
    variables: tuple[int, ...]
    strength: int


@dataclass(frozen=True)
class Combination:
    """One cell. variables: rising. categories: of each. weight: points that are wanted in it, whatever its categories weigh."""

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
        """The combinations of k variables alone: they change weights in the planes of every k variables."""
        return Extras(
            combinations=tuple(one for one in self.combinations if len(one.variables) == k)
        )

    def weights(self) -> dict[tuple[int, ...], dict[tuple[int, ...], int]]:
        """The weights of single cells, by plane and cell."""
        found: dict[tuple[int, ...], dict[tuple[int, ...], int]] = {}
        for one in self.combinations:
            found.setdefault(one.variables, {})[one.categories] = one.weight
        return found


NOTHING = Extras()


@dataclass(frozen=True)
class Mixed:
    """Every `strength` variables are combined, and the extras."""

    strength: int
    extras: Extras = NOTHING


def all_planes(count: int, mixed: Mixed) -> Planes:
    """The planes of `count` variables: of every `strength` of them, the named ones, then those of which single cells are wanted."""
    whole = [*combinations(range(count), mixed.strength)]
    for named in mixed.extras.planes:
        whole += combinations(named.variables, named.strength)
    planes: dict[tuple[int, ...], frozenset[tuple[int, ...]] | None] = dict.fromkeys(whole)
    for plane, weights in mixed.extras.weights().items():
        planes.setdefault(plane, frozenset(weights))
    return planes


def copy_for(constraints: Constraints, planes: Planes) -> Constraints:
    """A copy for one search; with one more variable, of one category, if planes have different sizes: it fills up the smaller ones.

    A copy, because a SAT solver's answers depend on earlier queries, and the same arguments must give the same rows.
    """
    several = len(set(map(len, planes))) > 1
    return Constraints(constraints.sizes + (1,) * several, constraints.clauses)


def filled_up(planes: Planes, idle: int) -> list[tuple[int, ...]]:
    """The planes, all as large as the largest. idle: the variable that fills them up."""
    most = max(map(len, planes))
    return [plane + (idle,) * (most - len(plane)) for plane in planes]
