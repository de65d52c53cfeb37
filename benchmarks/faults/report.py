"""The one table of all fault programs."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

PUBLISHED = Path("docs/results/faults.csv")


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
        lines.append(
            _line(
                Row(
                    fault,
                    "all",
                    sum(row.count for row in own),
                    sum(row.wrong for row in own),
                    total,
                )
            )
        )
    return "\n".join(lines)


def keep(rows: Sequence[Row], path: Path = PUBLISHED) -> None:
    """Publish the rows: a line for each outcome of a fault in a place. They replace those of the same kinds of fault."""
    for row in rows:
        if row.count and not sum(row.outcomes.values()):
            raise ValueError(
                f"{row.fault}, {row.where}: {row.count} faults without an outcome would not be published"
            )
    fresh = {row.fault for row in rows}
    kept = [row for row in published(path) if row.fault not in fresh] if path.exists() else []
    with path.open("w", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(["fault", "where", "number", "wrong", "outcome", "times"])
        for row in [*kept, *rows]:
            lines.writerows(
                [row.fault, row.where, row.count, row.wrong, way, times]
                for way, times in row.outcomes.items()
                if times
            )


def published(path: Path = PUBLISHED) -> list[Row]:
    """The published rows."""
    rows: dict[tuple[str, str], Row] = {}
    with path.open(newline="") as file:
        for line in csv.DictReader(file):
            place = (line["fault"], line["where"])
            known = rows.get(place, Row(*place, int(line["number"]), int(line["wrong"]), {}))
            rows[place] = Row(
                *place,
                known.count,
                known.wrong,
                {**known.outcomes, line["outcome"]: int(line["times"])},
            )
    return list(rows.values())


def page(rows: Sequence[Row]) -> str:
    """The rows as a table of a page, a line for each kind of fault."""
    lines = ["| fault | times | places | ended wrong | outcomes |", "|---|---|---|---|---|"]
    for fault in dict.fromkeys(row.fault for row in rows):
        own = [row for row in rows if row.fault == fault]
        total = sum((Counter(row.outcomes) for row in own), Counter[str]())
        numbers = f"{sum(row.count for row in own)} | {sum(row.count > 0 for row in own)} | {sum(row.wrong for row in own)}"
        lines.append(
            f"| {fault} | {numbers} | {', '.join(f'{way}: {times}' for way, times in total.items())} |"
        )
    return "\n".join(lines)


def _line(row: Row) -> str:
    outcome = ", ".join(f"{way} {count}" for way, count in row.outcomes.items() if count)
    return f"{row.fault:12} {row.where:22} {row.count:>7} {row.wrong:>6}  {outcome}"
