"""What identifies the worlds that images show: their towns and their people."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Worlds:
    """Fingerprints of towns and of populations."""

    towns: frozenset[str] = frozenset()
    people: frozenset[str] = frozenset()

    @staticmethod
    def of(town: str, people: str) -> Worlds:
        """One town and one population; an empty text stands for none."""
        return Worlds(frozenset({town} - {""}), frozenset({people} - {""}))

    @staticmethod
    def union(worlds: Iterable[Worlds]) -> Worlds:
        """All their towns and people."""
        every = list(worlds)
        return Worlds(
            frozenset().union(*(world.towns for world in every)),
            frozenset().union(*(world.people for world in every)),
        )

    def __iter__(self) -> Iterator[tuple[str, str]]:
        """Yield kind, `town` or `people`, and fingerprint of each, in order."""
        yield from (("town", town) for town in sorted(self.towns))
        yield from (("people", people) for people in sorted(self.people))

    def __and__(self, other: Worlds) -> Worlds:
        """What both contain."""
        return Worlds(self.towns & other.towns, self.people & other.people)

    def __bool__(self) -> bool:
        """Whether there is a town or a population."""
        return bool(self.towns or self.people)
