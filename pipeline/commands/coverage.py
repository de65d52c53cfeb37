"""The commands `coverage score`, `propose`, `plan` and `verify`: coverage of any data set, what to add to it, and plans from nothing."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import islice
from math import comb
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.artefacts.space_file import read_points, read_space_file, write_points
from pipeline.core.constraints import Bools
from pipeline.core.coverage import arrays, counting
from pipeline.core.coverage.arrays import Effort, covering_array
from pipeline.core.coverage.conditions import OperatingSpace
from pipeline.core.coverage.counting import CellCounts
from pipeline.core.coverage.projection import Combine, Coverage, Plane, planes, total
from pipeline.core.coverage.proposals import Proposer
from pipeline.core.coverage.verification import verify as verify_rows
from pipeline.core.space import Ints
from pipeline.errors import InputError
from pipeline.progress import Progress

MOST_CELLS = 200_000_000
LISTED = 1000
"""Cells that --json lists at most; their number is always whole."""
SHOWN = 12
NEXT_POINTS = 5
GROWTH_STEPS = 60
Found = dict[str, Any]


def score(
    *, space: Path, points: Path, k: int, operator: Combine, metadata: Path | None, figures: Path | None, progress: Progress
) -> tuple[Found, str]:
    """Coverage of a table of points: as a mapping for --json, and as text."""
    known = read_space_file(space)
    _check_k("--k", k, known)
    rows = read_points(points, known, metadata=metadata)
    _announce_compilation()
    by_k = {}
    for lower in range(1, k + 1):
        by_k[lower] = _planes(known, rows, lower, operator)
        progress(lower, k, f"k = {lower}")
    coverage = {lower: _total(space, by_k[lower]) for lower in by_k}
    every = by_k[k]
    found: Found = {
        **_fraction(coverage[k]),
        "k": k,
        "operator": operator,
        "points": len(rows),
        "by_k": [{"k": lower, **_fraction(value)} for lower, value in coverage.items()],
        "planes": [_plane(known, plane) for plane in every[:LISTED]],
        "uncovered_cells": sum(int(_wanting(plane).sum()) for plane in every),
        "uncovered": list(islice(_cells(known, every, _wanting), LISTED)),
        "infeasible_cells": sum(int(_infeasible(plane).sum()) for plane in every),
        "infeasible": list(islice(_cells(known, every, _infeasible), LISTED)),
        "next": _next_points(known, rows, k, operator) if coverage[k].covered < coverage[k].required else [],
    }
    if figures:
        found["figures"] = [str(path) for path in _draw(figures, known, rows, k, operator, every)]
    return found, _score_text(found, known)


def propose(
    *,
    space: Path,
    points: Path | None,
    k: int,
    operator: Combine,
    count: int,
    complete: bool,
    exact: bool,
    heavy_first: bool,
    seconds: float,
    seed: int,
    metadata: Path | None,
    output: Path | None,
    progress: Progress,
) -> tuple[Found, str]:
    """The next points that raise coverage most, or all that complete it."""
    known = read_space_file(space)
    _check_k("--k", k, known)
    if count < 1:
        raise InputError(f"--count must be at least 1, got {count}")
    rows = np.zeros((0, len(known.sizes)), np.int64) if points is None else read_points(points, known, metadata=metadata, empty=True)
    before = _total(space, _planes(known, rows, k, operator))
    _announce_compilation()
    proposer = Proposer(known.constraints, k, weights=known.weights, combine=operator, heavy_first=heavy_first, seed=seed)
    progress(0, 1, f"{before.covered} of {before.required} covered")
    needed = proposer.fewest(rows)
    found = None if complete else proposer.propose_exact(rows, count, seconds) if exact else proposer.propose(rows, count)
    added = proposer.completion(rows) if complete else rows[:0] if found is None else found.categories
    after = _total(space, _planes(known, np.vstack([rows, added]), k, operator))
    progress(1, 1, f"{after.covered} of {after.required} covered")
    if output:
        write_points(output, known, added)
    covered = after.covered - before.covered
    gain, bound = (covered, covered) if found is None else (found.gain, found.bound)
    result: Found = {
        "count": len(added),
        "needed_at_least": needed,
        "k": k,
        "operator": operator,
        "gain": gain,
        "bound": bound,
        "gap": bound - gain,
        "optimal": len(added) == needed if complete else bound == gain,
        "before": _fraction(before),
        "after": _fraction(after),
        "points": known.decode(added),
    }
    lines = [f"{k}-projection coverage {_percent(before)}, with {len(added)} more points {_percent(after)}"]
    if not len(added):
        lines = [f"{k}-projection coverage is {_percent(before)}: nothing to propose"]
    elif complete:
        lines.append("No fewer points complete it." if result["optimal"] else f"No fewer than {needed} points could.")
    elif bound == gain:
        lines.append("No other points are worth more." if heavy_first else "No other points gain more.")
    elif heavy_first:
        lines.append(f"The cells that they fill weigh {gain}; none can weigh more than {bound}.")
    else:
        lines.append(f"They gain {gain}; no points can gain more than {bound}.")
    lines += ["", *_table([list(known.names), *([row[name] for name in known.names] for row in known.decode(added))])] if len(added) else []
    return result, "\n".join(lines)


def plan(
    *, space: Path, strength: int, effort: str, seconds: float, seed: int, include: Path | None, output: Path | None, progress: Progress
) -> tuple[Found, str]:
    """A covering array: few points in which every combination of categories of any `strength` conditions occurs."""
    known = read_space_file(space)
    _check_k("--strength", strength, known)
    seeds = None if include is None else read_points(include, known)
    started = time.monotonic()
    _announce_compilation()

    def told(share: float, size: int, bound: int) -> None:
        progress(min(999, int(1000 * share)), 1000, f"{size} points, at least {bound} needed")

    search = Effort(seconds if effort == "polish" else None, told)
    array = covering_array(known.constraints, strength, seeds=seeds, seed=seed, effort=search)
    progress(1000, 1000, f"{array.size} points")
    if output:
        write_points(output, known, array.rows)
    found: Found = {
        "size": array.size,
        "lower_bound": array.lower_bound,
        "gap": array.size - array.lower_bound,
        "optimal": array.size == array.lower_bound,
        "cells": array.cells,
        "strength": strength,
        "effort": effort,
        "seconds": round(time.monotonic() - started, 3),
    }
    sure = "no plan has fewer" if found["optimal"] else f"no plan has fewer than {array.lower_bound}"
    return found, f"{array.size} points cover all {array.cells:,} feasible combinations of {strength} conditions; {sure}."


def verify(*, space: Path, points: Path, strength: int, progress: Progress) -> tuple[Found, str]:
    """Check a plan by other means than those that made it."""
    known = read_space_file(space)
    _check_k("--strength", strength, known)
    rows = read_points(points, known)
    checked = verify_rows(rows, known.constraints, strength, progress)
    missing = [
        {known.names[v]: known.conditions[v].labels[c] for v, c in zip(plane, cell, strict=True)}
        for plane, cell in checked.missing[:LISTED]
    ]
    found: Found = {
        "valid": checked.valid,
        "size": checked.rows,
        "strength": strength,
        "cells": checked.cells,
        "infeasible_cells": checked.infeasible,
        "missing_cells": len(checked.missing),
        "missing": missing,
    }
    if checked.valid:
        return found, f"valid: {checked.rows} points cover all {checked.cells:,} feasible combinations of {strength} conditions"
    listed = "\n".join("  " + ", ".join(f"{name} = {label}" for name, label in cell.items()) for cell in missing[:SHOWN])
    return found, f"not valid: {len(checked.missing):,} of {checked.cells:,} feasible combinations are missing, among them\n{listed}"


def _check_k(option: str, k: int, space: OperatingSpace) -> None:
    if not 1 <= k <= len(space.sizes):
        raise InputError(f"{option} must be in [1, {len(space.sizes)}], the number of conditions; got {k}")
    largest = np.sort(space.sizes)[::-1].astype(float)
    cells = comb(len(space.sizes), k) * float(np.exp(k * np.mean(np.log(largest))))
    if cells > MOST_CELLS:
        raise InputError(f"{option} = {k}: about {cells:.2g} cells are more than the {MOST_CELLS:.0e} that fit; choose a smaller one")


def _planes(space: OperatingSpace, rows: Ints, k: int, operator: Combine) -> list[Plane]:
    counts = CellCounts(space.sizes, k)
    counts.add(rows)
    return list(planes(counts, weights=space.weights, combine=operator, constraints=space.constraints))


def _total(path: Path, every: Iterable[Plane]) -> Coverage:
    try:
        return total(every)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def _wanting(plane: Plane) -> Bools:
    return np.asarray(plane.counts < plane.wanted)


def _infeasible(plane: Plane) -> Bools:
    return ~plane.feasible


def _cells(space: OperatingSpace, every: Iterable[Plane], which: Callable[[Plane], Bools]) -> Iterator[Mapping[str, str]]:
    """The cells of all planes that `which` marks, by names."""
    for plane in every:
        for cell in np.argwhere(which(plane)):
            conditions = [space.conditions[c] for c in plane.conditions]
            yield {c.name: c.labels[int(v)] for c, v in zip(conditions, cell, strict=True)}


def _plane(space: OperatingSpace, plane: Plane) -> Found:
    own = plane.coverage
    return {
        "conditions": [space.names[c] for c in plane.conditions],
        **({"numerator": 0, "denominator": 0, "coverage": None} if own is None else _fraction(own)),
        "uncovered_cells": int(_wanting(plane).sum()),
        "infeasible_cells": int(_infeasible(plane).sum()),
    }


def _next_points(space: OperatingSpace, rows: Ints, k: int, operator: Combine) -> list[dict[str, str]]:
    found = Proposer(space.constraints, k, weights=space.weights, combine=operator).propose(rows, NEXT_POINTS)
    return [] if found is None else space.decode(found.categories)


def _draw(folder: Path, space: OperatingSpace, rows: Ints, k: int, operator: Combine, every: list[Plane]) -> list[Path]:
    from pipeline.report import coverage_plots as draw
    from pipeline.report.style import save_png

    paths = [folder / "growth.png"]
    ends = np.unique(np.linspace(1, len(rows), min(len(rows), GROWTH_STEPS)).astype(int))
    save_png(draw.growth([(int(end), total(_planes(space, rows[:end], k, operator)).ratio) for end in ends], k), paths[0])
    if len(space.sizes) >= 2:
        pairs = every if k == 2 else _planes(space, rows, 2, operator)
        paths.append(folder / "planes.png")
        save_png(draw.heat_maps(pairs, space), paths[1])
    return paths


def _fraction(coverage: Coverage) -> Found:
    return {"numerator": coverage.covered, "denominator": coverage.required, "coverage": coverage.ratio}


def _percent(coverage: Coverage) -> str:
    return f"{coverage.covered:,}/{coverage.required:,} = {100 * coverage.ratio:.2f} %"


def _score_text(found: Found, space: OperatingSpace) -> str:
    lines = [f"{found['points']:,} points, {len(space.sizes)} conditions, weights combined by {found['operator']}", ""]
    lines += _table(
        [["k", "covered", "wanted", "coverage"]]
        + [[str(x["k"]), f"{x['numerator']:,}", f"{x['denominator']:,}", f"{100 * x['coverage']:.2f} %"] for x in found["by_k"]]
    )
    least = sorted((p for p in found["planes"] if p["coverage"] is not None), key=lambda p: p["coverage"])[:SHOWN]
    lines += ["", f"Least covered of {len(found['planes'])} planes"]
    lines += _table(
        [["plane", "covered", "wanted", "coverage"]]
        + [[" × ".join(p["conditions"]), f"{p['numerator']:,}", f"{p['denominator']:,}", f"{100 * p['coverage']:.1f} %"] for p in least]
    )
    for title, cells in (("uncovered", found["uncovered"]), ("provably infeasible", found["infeasible"])):
        number = found[f"{title.split()[-1]}_cells"]
        lines += ["", f"{number:,} cells are {title}{', among them' if number > SHOWN else ':' if number else '.'}"]
        lines += ["  " + ", ".join(f"{name} = {label}" for name, label in cell.items()) for cell in cells[:SHOWN]]
    if found["next"]:
        lines += ["", "What to collect next, most useful first"]
        lines += _table([list(space.names), *([row[name] for name in space.names] for row in found["next"])])
    lines += [f"drawn: {path}" for path in found.get("figures", ())]
    return "\n".join(lines)


def _table(rows: list[list[str]]) -> list[str]:
    """Rows as aligned text, the first as the head."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return ["  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _announce_compilation() -> None:
    """Say why the first call on a machine takes longer."""
    cached = Path(arrays.__file__).parent / "__pycache__"
    if not any(cached.glob("annealing.*.nbi")) or not any(cached.glob("counting.*.nbi")):
        print(f"compiling the kernels of {counting.__package__}, once on this machine …", file=sys.stderr, flush=True)
