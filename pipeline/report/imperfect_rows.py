"""What a table's imperfect rows are and whether they count: as a mapping and as text."""

from __future__ import annotations

from typing import Any

from pipeline.analysis.data_coverage import LISTED
from pipeline.artefacts.point_table import PointTable

SHOWN = 12
"""Longest list in a text."""


def imperfect(table: PointTable) -> dict[str, Any]:
    """Of a table whose rows are all read. points: rows that count. partial: those of them without a category for some condition. left_out:
    rows that break a constraint. causes: what is wrong, most frequent first, with the first row of each."""
    faults = sorted(table.faults, key=lambda fault: -fault.rows)
    return {
        "rows": table.rows,
        "points": table.points,
        "partial": table.partial,
        "left_out": table.rows - table.points,
        "causes": [
            {"cause": table.told(fault), "rows": fault.rows, "left_out": fault.left_out}
            for fault in faults[:LISTED]
        ],
        "more_causes": len(faults[LISTED:]),
        "unused_metadata": table.unused,
    }


def imperfect_text(found: dict[str, Any]) -> list[str]:
    """Lines on the imperfect rows, none if there are none."""
    lines = (
        [f"{found['unused_metadata']:,} rows of the metadata belong to no image."]
        if found["unused_metadata"]
        else []
    )
    if not found["causes"]:
        return lines
    lines += [
        f"{found['points']:,} of {found['rows']:,} rows count; partial, so only for the conditions that they give: {found['partial']:,}; "
        f"left out, because they break a constraint: {found['left_out']:,}"
    ]
    lines += [f"  {cause['rows']:,} × {cause['cause']}" for cause in found["causes"][:SHOWN]]
    hidden = len(found["causes"][SHOWN:]) + found["more_causes"]
    return [*lines, *([f"  and {hidden:,} more causes"] if hidden else []), ""]
