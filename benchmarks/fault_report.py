"""The one table of all fault programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """Faults of one kind in one place. wrong: how many did not end as they should. outcomes: how many ended in which way."""

    fault: str
    where: str
    count: int
    wrong: int
    outcomes: Mapping[str, int]


def table(rows: Sequence[Row]) -> str:
    """The rows as text, with a sum for each kind of fault."""
    lines = [f"{'fault':12} {'where':22} {'number':>7} {'wrong':>6}  outcome"]
    for fault in dict.fromkeys(row.fault for row in rows):
        own = [row for row in rows if row.fault == fault]
        lines += [_line(row) for row in own]
        ways = dict.fromkeys(way for row in own for way in row.outcomes)
        total = {way: sum(row.outcomes.get(way, 0) for row in own) for way in ways}
        lines.append(_line(Row(fault, "all", sum(row.count for row in own), sum(row.wrong for row in own), total)))
    return "\n".join(lines)


def _line(row: Row) -> str:
    outcome = ", ".join(f"{way} {count}" for way, count in row.outcomes.items() if count)
    return f"{row.fault:12} {row.where:22} {row.count:>7} {row.wrong:>6}  {outcome}"
