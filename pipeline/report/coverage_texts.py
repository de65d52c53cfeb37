"""The answers of `coverage` as text."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.analysis.data_coverage import Found
from pipeline.core.coverage.projection import Coverage
from pipeline.core.space import Ints, Space
from pipeline.report.formats import in_columns
from pipeline.report.imperfect_rows import SHOWN

SMALLEST = "This is the smallest possible number."


def percent_text(coverage: Coverage) -> str:
    """`12/16 = 75.00 %`."""
    return f"{coverage.covered:,}/{coverage.required:,} = {100 * coverage.ratio:.2f} %"


def cell_text(cell: Mapping[str, str]) -> str:
    """`rain = heavy, fog = none`."""
    return ", ".join(f"{name} = {label}" for name, label in cell.items())


def row_text(space: Space, row: Ints) -> str:
    """The same of a whole row of categories, (d,)."""
    return cell_text(space.names_of(row[None])[0])


def _points_table(points: list[dict[str, str]]) -> list[str]:
    return _table([list(points[0]), *(list(point.values()) for point in points)])


def score_text(found: Found, space: Space) -> str:
    """What `score` found."""
    lines = [
        f"{found['points']:,} points, {len(space)} conditions, weights combined by {found['operator']}",
        "",
    ]
    lines += _table(
        [["k", "covered", "wanted", "coverage"]]
        + [
            [
                str(x["k"]),
                f"{x['numerator']:,}",
                f"{x['denominator']:,}",
                f"{100 * x['coverage']:.2f} %",
            ]
            for x in found["by_k"]
        ]
    )
    if space.extras:
        lines += ["", *_extras_text(found)]
    least = [p for p in found["planes"] if p["coverage"] is not None][:SHOWN]
    lines += ["", f"Least covered of {found['plane_count']:,} planes"]
    lines += _table(
        [["plane", "covered", "wanted", "coverage"]]
        + [
            [
                " × ".join(p["conditions"]),
                f"{p['numerator']:,}",
                f"{p['denominator']:,}",
                f"{100 * p['coverage']:.1f} %",
            ]
            for p in least
        ]
    )
    for title, cells in (
        ("uncovered", found["uncovered"]),
        ("provably infeasible", found["infeasible"]),
    ):
        number = found[f"{title.split()[-1]}_cells"]
        lines += [
            "",
            f"{number:,} cells are {title}{', among them' if number > SHOWN else ':' if number else '.'}",
        ]
        lines += [f"  {cell_text(cell)}" for cell in cells[:SHOWN]]
    if found["next"]:
        lines += ["", "What to collect next, most useful first"]
        lines += _points_table(found["next"])
    lines += [f"drawn: {path}" for path in found.get("figures", ())]
    return "\n".join(lines)


def _extras_text(found: Found) -> list[str]:
    named = [
        [f"{x['name']}: {x['strength']} of {' × '.join(x['conditions'])}", x]
        for x in found["named_planes"]
    ]
    rows = [[name, f"{x['numerator']:,}", f"{x['denominator']:,}"] for name, x in named]
    rows += [
        [cell_text(x["of"]), f"{min(x['points'], x['weight']):,}", f"{x['weight']:,}"]
        for x in found["combinations"]
    ]
    whole = f"{found['numerator']:,}/{found['denominator']:,} = {100 * found['coverage']:.2f} %"
    return [
        *_table([["named planes and combinations", "covered", "wanted"], *rows]),
        f"k = {found['k']} with these: {whole}",
    ]


def _table(rows: list[list[str]]) -> list[str]:
    """Rows as aligned text, the first as the head."""
    return [f"  {line}" for line in in_columns(rows)]


def propose_text(
    found: Found, complete: bool, heavy_first: bool, coverage: tuple[str, Coverage, Coverage]
) -> str:
    """What `propose` found. coverage: its name, and what it is before and after."""
    name, before, after = coverage
    if not found["count"]:
        return f"{name} is {percent_text(before)}: nothing to propose"
    lines = [
        f"{name} {percent_text(before)}, with {found['count']} more points {percent_text(after)}"
    ]
    if complete:
        needed = found["needed_at_least"]
        lines.append(
            SMALLEST if found["optimal"] else f"No fewer than {needed} points complete it."
        )
    elif found["optimal"]:
        lines.append(
            "No other points are worth more." if heavy_first else "No other points gain more."
        )
    elif heavy_first:
        lines.append(
            f"The cells that they fill weigh {found['gain']}; none can weigh more than {found['bound']}."
        )
    else:
        lines.append(f"They gain {found['gain']}; no points can gain more than {found['bound']}.")
    return "\n".join([*lines, "", *_points_table(found["points"])])
