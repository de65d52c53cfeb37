"""Shards: equal parts of a campaign whose strategy does not learn, so that several machines can share it."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Shard:
    """One of `count` parts of a campaign; number: from 0. Its name is its number from 1 and the count, as in `3of16`."""

    number: int
    count: int

    PATTERN = r"\d+of\d+"

    def __post_init__(self) -> None:
        if not 0 <= self.number < self.count:
            raise ValueError(f"a shard must be 1 to {self.count} of {self.count}, got {self}")

    @staticmethod
    def named(name: str) -> Shard:
        """The shard of a name; ValueError for any other text."""
        if not re.fullmatch(Shard.PATTERN, name):
            raise ValueError(f"expected a shard such as 3of16, got '{name}'")
        number, count = map(int, name.split("of"))
        return Shard(number - 1, count)

    @staticmethod
    def of(tests: int, count: int) -> list[Shard]:
        """The shards of a campaign: `count`, but at most one a test; none if the whole campaign is one job."""
        shared = min(tests, count)
        return [Shard(number, shared) for number in range(shared)] if shared > 1 else []

    def tests(self, total: int) -> range:
        """The indices of its tests in a campaign of `total` tests; the shards' ranges follow each other."""
        return range(total * self.number // self.count, total * (self.number + 1) // self.count)

    def __str__(self) -> str:
        return f"{self.number + 1}of{self.count}"
