"""Finds the category that a text of a table means.

It is the one written like it, or the only one that is the same value spelt differently.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Sequence
from datetime import UTC, datetime
from decimal import Decimal

from pipeline.core.comparisons import NUMBER

TIME = re.compile(
    r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d{1,6})?)?(Z|[+-]\d\d:?\d\d)?)?", re.ASCII
)


def _truth(text: str) -> bool | None:
    return {"true": True, "false": False}.get(text.strip().lower())


def _number(text: str) -> Decimal | None:
    return Decimal(text.strip()) if NUMBER.fullmatch(text.strip()) else None


class Spellings:
    """The names of categories, which must be distinct.

    A text that is no name means a name with other space around it, the same truth value, number
    (exactly) or time (UTC, if it has no zone), if there is only one such name: `2.0` means `2`, but
    with the names `1` and `1.0`, `1.00` means neither.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._written = {name: index for index, name in enumerate(names)}
        self._alike: list[tuple[Callable[[str], Hashable], dict[Hashable, list[int]]]] = []
        for meaning in (str.strip, _truth, _number, time_of):
            alike: dict[Hashable, list[int]] = {}
            for index, name in enumerate(names):
                alike.setdefault(meaning(name), []).append(index)
            alike.pop(None, None)
            self._alike.append((meaning, alike))

    def find(self, text: str) -> int:
        """Index of the name that the text means, -1 for none."""
        if text in self._written:
            return self._written[text]
        for meaning, alike in self._alike:
            if same := alike.get(meaning(text)):
                return same[0] if len(same) == 1 else -1
        return -1


def time_of(text: str) -> datetime | None:
    """The time that a text says, in UTC and without a zone; None for another text."""
    if not TIME.fullmatch(text.strip()):
        return None
    try:
        time = datetime.fromisoformat(text.strip())
        if time.tzinfo is not None:
            time = time.astimezone(UTC)
        return time.replace(tzinfo=None)
    except (ValueError, OverflowError):
        return None
