"""Shards: equal parts of a campaign, so that several machines can share it."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Shard:
    """A part of a campaign whose strategy does not learn.

    number: from 0. count: of the campaign's shards. Its name counts from 1, as in `3of16`.
    """

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
        """The shards of a campaign, at most one a test; none if a single job executes all tests."""
        shared = min(tests, count)
        return [Shard(number, shared) for number in range(shared)] if shared > 1 else []

    def tests(self, total: int) -> range:
        """The indices of its tests in a campaign of `total` tests.

        >>> Shard.named("2of3").tests(10)
        range(3, 6)
        """
        return range(total * self.number // self.count, total * (self.number + 1) // self.count)

    def __str__(self) -> str:
        return f"{self.number + 1}of{self.count}"
