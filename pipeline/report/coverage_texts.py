"""The answers of `coverage` as text, and the imperfect rows of a table as a mapping and as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.analysis.data_coverage import LISTED, Answer
from pipeline.artefacts.point_table import PointTable
from pipeline.core.coverage.projection import Coverage
from pipeline.core.space import Ints, Space
from pipeline.report.formats import in_columns

SHOWN = 12
"""Longest list in a text."""
SMALLEST = "This is the smallest possible number."


def percent_text(coverage: Coverage) -> str:
    """`12/16 = 75.00 %`."""
    return f"{coverage.covered:,}/{coverage.required:,} = {100 * coverage.ratio:.2f} %"


def cell_text(cell: Mapping[str, str]) -> str:
    """`rain = heavy, fog = none`."""
    return ", ".join(f"{name} = {label}" for name, label in cell.items())


def row_text(space: Space, row: Ints) -> str:
    """`rain = heavy, fog = none`, of a row of categories, (d,)."""
    return cell_text(space.names_of(row[None])[0])


def score_text(answer: Answer, space: Space) -> str:
    """The answer of `score` as lines of text."""
    points = f"{answer['points']:,} points, {len(space)} conditions"
    lines = [f"{points}, weights combined by {answer['operator']}", ""]
    rows = [["k", "covered", "wanted", "coverage"]]
    for level in answer["by_k"]:
        rows.append([str(level["k"]), *_fraction(level), f"{100 * level['coverage']:.2f} %"])
    lines += _table(rows)
    if space.extras:
        lines += ["", *_extras_text(answer)]
    lines += ["", f"Least covered of {answer['plane_count']:,} planes"]
    rows = [["plane", "covered", "wanted", "coverage"]]
    for plane in [plane for plane in answer["planes"] if plane["coverage"] is not None][:SHOWN]:
        name, ratio = " × ".join(plane["conditions"]), f"{100 * plane['coverage']:.1f} %"
        rows.append([name, *_fraction(plane), ratio])
    lines += _table(rows)
    for title, key in (("uncovered", "uncovered"), ("provably infeasible", "infeasible")):
        cells, number = answer[key], answer[f"{key}_cells"]
        end = ":" if number else "."
        if number > SHOWN:
            end = ", among them"
        lines += ["", f"{number:,} cells are {title}{end}"]
        lines += [f"  {cell_text(cell)}" for cell in cells[:SHOWN]]
    if answer["next"]:
        lines += ["", "What to collect next, most useful first", *_points_table(answer["next"])]
    lines += [f"drawn: {path}" for path in answer.get("figures", ())]
    return "\n".join(lines)


def _fraction(answer: Answer) -> tuple[str, str]:
    return f"{answer['numerator']:,}", f"{answer['denominator']:,}"


def _extras_text(answer: Answer) -> list[str]:
    """Coverage of the named planes and of the single combinations."""
    rows = [["named planes and combinations", "covered", "wanted"]]
    for plane in answer["named_planes"]:
        combined = f"{plane['strength']} of {' × '.join(plane['conditions'])}"
        rows.append([f"{plane['name']}: {combined}", *_fraction(plane)])
    for single in answer["combinations"]:
        covered = min(single["points"], single["weight"])
        rows.append([cell_text(single["of"]), f"{covered:,}", f"{single['weight']:,}"])
    numerator, denominator = _fraction(answer)
    whole = f"{numerator}/{denominator} = {100 * answer['coverage']:.2f} %"
    return [*_table(rows), f"k = {answer['k']} with these: {whole}"]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows as aligned text, the first as the head."""
    return [f"  {line}" for line in in_columns(rows)]


def _points_table(points: Sequence[Mapping[str, str]]) -> list[str]:
    return _table([list(points[0]), *(list(point.values()) for point in points)])


def propose_text(
    answer: Answer, complete: bool, heavy_first: bool, name: str, before: Coverage, after: Coverage
) -> str:
    """The answer of `propose` as lines of text.

    Args:
        answer: The answer as a mapping.
        complete: Whether the points complete the coverage.
        heavy_first: Whether cells of larger weight come first.
        name: Name of the coverage.
        before: Coverage without the proposed points.
        after: Coverage with them.
    """
    if not answer["count"]:
        return f"{name} is {percent_text(before)}: nothing to propose"
    more = f"with {answer['count']} more points {percent_text(after)}"
    lines = [f"{name} {percent_text(before)}, {more}"]
    gain, bound = answer["gain"], answer["bound"]
    if complete and answer["optimal"]:
        lines.append(SMALLEST)
    elif complete:
        lines.append(f"No fewer than {answer['needed_at_least']} points complete it.")
    elif answer["optimal"]:
        lines.append(f"No other points {'are worth' if heavy_first else 'gain'} more.")
    elif heavy_first:
        lines.append(f"The cells that they fill weigh {gain}; none can weigh more than {bound}.")
    else:
        lines.append(f"They gain {gain}; no points can gain more than {bound}.")
    return "\n".join([*lines, "", *_points_table(answer["points"])])


def imperfect(table: PointTable) -> dict[str, Any]:
    """The imperfect rows of a table whose rows are all read.

    Returns:
        `points`: rows that count; `partial`: those of them without a category for some condition;
        `left_out`: rows that break a constraint; `causes`: the faults, most frequent first, with
        the first row of each.
    """
    faults = sorted(table.faults, key=lambda fault: -fault.rows)
    causes = []
    for fault in faults[:LISTED]:
        cause = {"cause": table.told(fault), "rows": fault.rows, "left_out": fault.left_out}
        causes.append(cause)
    return {
        "rows": table.rows,
        "points": table.points,
        "partial": table.partial,
        "left_out": table.rows - table.points,
        "causes": causes,
        "more_causes": len(faults[LISTED:]),
        "unused_metadata": table.unused,
    }


def imperfect_text(answer: Mapping[str, Any]) -> list[str]:
    """Lines on the imperfect rows, empty without any."""
    lines = []
    if answer["unused_metadata"]:
        lines.append(f"{answer['unused_metadata']:,} rows of the metadata belong to no image.")
    if not answer["causes"]:
        return lines
    lines.append(
        f"{answer['points']:,} of {answer['rows']:,} rows count; partial, so only for the "
        f"conditions that they give: {answer['partial']:,}; left out, because they break a "
        f"constraint: {answer['left_out']:,}"
    )
    lines += [f"  {cause['rows']:,} × {cause['cause']}" for cause in answer["causes"][:SHOWN]]
    if hidden := len(answer["causes"][SHOWN:]) + answer["more_causes"]:
        lines.append(f"  and {hidden:,} more causes")
    return [*lines, ""]
