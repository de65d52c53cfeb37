"""The one table of all fault programs; `python -m benchmarks.faults.report` prints the page's."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.shared import RESULTS, markdown

PUBLISHED = RESULTS / "faults.csv"


@dataclass(frozen=True)
class Row:
    """Faults of one kind in one place.

    count: their number. wrong: how many did not end as they should. outcomes: how many ended in
    which way.
    """

    fault: str
    where: str
    count: int
    wrong: int
    outcomes: Mapping[str, int]


def totals(rows: Sequence[Row]) -> list[Row]:
    """The sum of each kind of fault over its places."""
    sums = []
    for fault in dict.fromkeys(row.fault for row in rows):
        same = [row for row in rows if row.fault == fault]
        outcomes: Counter[str] = Counter()
        for row in same:
            outcomes.update(row.outcomes)
        count, wrong = sum(row.count for row in same), sum(row.wrong for row in same)
        sums.append(Row(fault, "all", count, wrong, outcomes))
    return sums


def table(rows: Sequence[Row]) -> str:
    """The rows as text, with the sum of each kind of fault after them."""
    lines = [f"{'fault':16} {'where':22} {'number':>7} {'wrong':>6}  outcome"]
    for row in (*rows, *totals(rows)):
        outcome = ", ".join(f"{way} {count}" for way, count in row.outcomes.items() if count)
        lines.append(f"{row.fault:16} {row.where:22} {row.count:>7} {row.wrong:>6}  {outcome}")
    return "\n".join(lines)


def keep(rows: Sequence[Row], path: Path = PUBLISHED) -> None:
    """Publish the rows in place of those of the same kinds of fault, a line for each outcome."""
    for row in rows:
        if row.count and not sum(row.outcomes.values()):
            raise ValueError(
                f"{row.fault}, {row.where}: {row.count} faults without an outcome "
                "would not be published"
            )
    fresh = {row.fault for row in rows}
    kept = [row for row in published(path) if row.fault not in fresh] if path.exists() else []
    with path.open("w", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(["fault", "where", "number", "wrong", "outcome", "times"])
        for row in [*kept, *rows]:
            for way, times in row.outcomes.items():
                if times:
                    lines.writerow([row.fault, row.where, row.count, row.wrong, way, times])


def published(path: Path = PUBLISHED) -> list[Row]:
    """The published rows."""
    rows: dict[tuple[str, str], Row] = {}
    with path.open(newline="") as file:
        for line in csv.DictReader(file):
            place = (line["fault"], line["where"])
            outcomes = dict(rows[place].outcomes) if place in rows else {}
            outcomes[line["outcome"]] = int(line["times"])
            rows[place] = Row(*place, int(line["number"]), int(line["wrong"]), outcomes)
    return list(rows.values())


def page(rows: Sequence[Row]) -> str:
    """The table of the page, a line for each kind of fault."""
    cells = []
    for total in totals(rows):
        places = sum(row.fault == total.fault and row.count > 0 for row in rows)
        outcomes = ", ".join(f"{way}: {times}" for way, times in total.outcomes.items())
        cells.append((total.fault, total.count, places, total.wrong, outcomes))
    return markdown(("fault", "times", "places", "ended wrong", "outcomes"), cells)


if __name__ == "__main__":
    print(page(published()))
