"""What `coverage score`, `propose`, `plan`, `verify` and `export` answer: as a mapping for --json, and as text.

Each function takes the checked options of its verb (`commands.coverage`).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.analysis.data_coverage import (
    LISTED,
    Found,
    cell_names,
    counted,
    details,
    fraction,
    growth,
    next_points,
    of_extras,
    planes_of,
)
from pipeline.artefacts.model_export import format_of, write_model
from pipeline.artefacts.point_table import read_points, write_points
from pipeline.artefacts.space_formats import read_space_of_any_format
from pipeline.core.coverage import arrays, counting
from pipeline.core.coverage.arrays import Effort
from pipeline.core.coverage.mixed import NOTHING, STRONGEST, Mixed
from pipeline.core.coverage.projection import Coverage, Demand, Plane, planes, total
from pipeline.core.coverage.verification import verify as verify_rows
from pipeline.core.space import Ints, Space
from pipeline.errors import InputError
from pipeline.progress import Progress
from pipeline.report.coverage_texts import cell_text, propose_text, row_text, score_text
from pipeline.report.imperfect_rows import SHOWN, imperfect, imperfect_text

# Solvers are imported where they are used: they take longer to import than a table of a hundred thousand points takes to count.
if TYPE_CHECKING:
    from pipeline.core.coverage.proposals import Proposal, Proposer

MOST_CELLS = 200_000_000


def score(options: argparse.Namespace, progress: Progress) -> tuple[Found, str]:
    """Coverage of a table of points."""
    space = _read_space(options, "k")
    demand = _demand(options, space)
    table = read_points(options.points, space, metadata=options.metadata)
    _announce_compilation()
    by_strength = [replace(demand, k=k, extras=space.extras.of(k)) for k in range(1, options.k + 1)]
    pairs = [replace(demand, k=2, extras=NOTHING)] if options.figures and len(space) > 1 else []
    demands = [*pairs, *by_strength, *([demand] if space.extras else [])]
    counts, raising = counted(
        table.counting(options.strict), demands, lambda rows: progress(0, 1, f"{rows:,} points")
    )
    every = [list(planes(cells, one)) for cells, one in zip(counts, demands, strict=True)]
    by_k = [_total(options.space, found) for found in every[len(pairs) : len(pairs) + options.k]]
    coverage = _total(options.space, every[-1])
    progress(1, 1, f"{table.points:,} points")
    found: Found = {
        **fraction(coverage),
        "k": options.k,
        "operator": options.operator,
        **imperfect(table),
        "by_k": [{"k": k, **fraction(value)} for k, value in enumerate(by_k, 1)],
        **of_extras(space, every[-1]),
        **details(space, every[-1]),
        "next": next_points(space, raising.points, demands[-1])
        if coverage.covered < coverage.required
        else [],
    }
    if options.figures:
        found["figures"] = [
            str(path)
            for path in _draw(
                options, space, growth(raising, coverage), every[0] if pairs else None
            )
        ]
    return found, "\n".join([*imperfect_text(found), score_text(found, space)])


def propose(options: argparse.Namespace, progress: Progress) -> tuple[Found, str]:
    """The next points that raise coverage most, or all that complete it."""
    from pipeline.core.coverage.proposals import Proposer

    space = _read_space(options, "k")
    if options.count < 1:
        raise InputError(f"--count must be at least 1, got {options.count}")
    demand = _demand(options, space)
    _announce_compilation()
    rows, existing = np.zeros((0, len(space)), np.int64), {}
    if options.points is not None:
        table = read_points(options.points, space, metadata=options.metadata, empty=True)
        _, raising = counted(
            table.counting(options.strict),
            [demand],
            lambda rows: progress(0, 1, f"{rows:,} points"),
        )
        rows, existing = raising.points, imperfect(table)
    before = _total(options.space, planes_of(rows, demand))
    proposer = Proposer(demand, heavy_first=options.heavy_first, seed=options.seed)
    progress(0, 1, f"{before.covered} of {before.required} covered")
    found, needed = _proposal(proposer, rows, options)
    after = _total(options.space, planes_of(np.vstack([rows, found.categories]), demand))
    progress(1, 1, f"{after.covered} of {after.required} covered")
    if options.output:
        write_points(options.output, space, found.categories)
    result: Found = {
        "count": len(found.categories),
        "needed_at_least": needed,
        "k": options.k,
        "operator": options.operator,
        "gain": found.gain,
        "bound": found.bound,
        "gap": found.bound - found.gain,
        "optimal": len(found.categories) == needed if options.complete else found.optimal,
        "before": fraction(before),
        "after": fraction(after),
        "points": space.names_of(found.categories),
        "existing": existing,
    }
    text = propose_text(
        result,
        options.complete,
        options.heavy_first,
        (f"{options.k}-projection coverage{_with(space)}", before, after),
    )
    return result, "\n".join([*(imperfect_text(existing) if existing else []), text])


def _proposal(proposer: Proposer, rows: Ints, options: argparse.Namespace) -> tuple[Proposal, int]:
    """What the options ask for, no points if nothing is missing; and a bound of the points that complete the coverage."""
    from pipeline.core.coverage.proposals import Proposal

    if options.complete:
        completion = proposer.completion(rows)
        added = completion.categories
        gain = int((proposer.missing(rows) - proposer.missing(np.vstack([rows, added]))).sum())
        return Proposal(added, gain, gain), completion.bound
    found = (
        proposer.propose_exact(rows, options.count, options.seconds)
        if options.exact
        else proposer.propose(rows, options.count)
    )
    return Proposal(rows[:0], 0, 0) if found is None else found, proposer.fewest(rows)


def plan(options: argparse.Namespace, progress: Progress) -> tuple[Found, str]:
    """A covering array: few points in which every combination of categories of any `strength` conditions occurs."""
    from pipeline.core.coverage.certified import certified_array

    space = _read_space(options, "strength")
    seeds = None if options.include is None else read_points(options.include, space).strict()
    started = time.monotonic()
    _announce_compilation()

    def told(share: float, size: int, bound: int) -> None:
        progress(min(999, int(1000 * share)), 1000, f"{size} points, at least {bound} needed")

    limit = options.seconds if options.cpu_seconds is None else options.cpu_seconds
    effort = Effort(
        (limit or None) if options.effort == "polish" else None,
        told,
        processor=options.cpu_seconds is not None,
    )
    array = certified_array(
        space.constraints,
        Mixed(options.strength, space.extras),
        seeds=seeds,
        seed=options.seed,
        effort=effort,
    )
    progress(1000, 1000, f"{array.size} points")
    if options.output:
        write_points(options.output, space, array.rows)
    found: Found = {
        "size": array.size,
        "lower_bound": array.lower_bound,
        "gap": array.size - array.lower_bound,
        "optimal": array.size == array.lower_bound,
        "cells": array.cells,
        "strength": options.strength,
        "effort": options.effort,
        "seconds": round(time.monotonic() - started, 3),
    }
    sure = (
        "this is the smallest possible number"
        if found["optimal"]
        else f"no plan has fewer than {array.lower_bound}"
    )
    return (
        found,
        f"{array.size} points cover all {array.cells:,} feasible combinations of {_combined(space, options.strength)}; {sure}.",
    )


def verify(options: argparse.Namespace, progress: Progress) -> tuple[Found, str]:
    """Check a plan by other means than those that made it."""
    space = _read_space(options, "strength")
    table = read_points(options.points, space)
    rows = table.complete()
    checked = verify_rows(rows, space.constraints, Mixed(options.strength, space.extras), progress)
    broken = [
        f"row {row + 1} breaks the constraint '{space.clause(clause)}': {row_text(space, rows[row])}"
        for row, clause in checked.broken
    ]
    missing = [cell_names(space, plane, cell) for plane, cell in checked.missing[:LISTED]]
    found: Found = {
        "valid": checked.valid,
        "size": checked.rows,
        "strength": options.strength,
        "cells": checked.cells,
        "infeasible_cells": checked.infeasible,
        "broken_rows": len({row for row, _ in checked.broken}),
        "broken": broken[:LISTED],
        "missing_cells": len(checked.missing),
        "missing": missing,
    }
    if checked.valid:
        combined = _combined(space, options.strength)
        return (
            found,
            f"valid: {checked.rows} points cover all {checked.cells:,} feasible combinations of {combined}",
        )
    lines = [f"not valid: {line}" for line in broken[:SHOWN]]
    if missing:
        lines.append(
            f"not valid: {len(checked.missing):,} of {checked.cells:,} feasible combinations are missing, among them"
        )
        lines += [f"  {cell_text(cell)}" for cell in missing[:SHOWN]]
    return found, "\n".join(lines)


def export(options: argparse.Namespace, progress: Progress) -> tuple[Found, str]:
    """Write the space as another tool's model, or as a space file."""
    space, kind = read_space_of_any_format(options.space), format_of(options.output, options.format)
    left_out = write_model(options.output, space, kind)
    progress(1, 1, f"{len(space)} conditions")
    found: Found = {
        "format": kind,
        "conditions": len(space),
        "constraints": len(space.clauses),
        "left_out": left_out,
    }
    lines = [
        f"{options.output}: {len(space)} conditions, {len(space.clauses)} constraints",
        *(f"left out: {what}" for what in left_out),
    ]
    return found, "\n".join(lines)


def _read_space(options: argparse.Namespace, option: str) -> Space:
    """The space of --space; InputError if --k or --strength does not fit it."""
    space, k = read_space_of_any_format(options.space), getattr(options, option)
    if not 1 <= k <= len(space):
        raise InputError(
            f"--{option} must be in [1, {len(space)}], the number of conditions; got {k}"
        )
    if options.verb == "plan" and k > STRONGEST:
        raise InputError(f"--strength must be in [1, {STRONGEST}], got {k}")
    by_strength = _cells(space.sizes, k)
    if (cells := sum(by_strength) if options.verb == "score" else by_strength[-1]) > MOST_CELLS:
        raise InputError(
            f"--{option} = {k}: about {cells:.2g} cells are more than the {MOST_CELLS:.0e} that fit; choose a smaller one"
        )
    _check_extras(options.space, space)
    return space


def _demand(options: argparse.Namespace, space: Space) -> Demand:
    """What --k and --operator ask for; InputError for weights that are too large for it."""
    try:
        return Demand(space.constraints, options.k, space.weights, options.operator, space.extras)
    except ValueError as error:
        raise InputError(f"{options.space}: {error}") from error


def _cells(sizes: Sequence[int], k: int) -> list[float]:
    """How many cells the planes of 1 to k conditions have: the sums of the products of that many sizes."""
    cells = [1.0] + [0.0] * k
    for size in sizes:
        for strength in range(k, 0, -1):
            cells[strength] += cells[strength - 1] * size
    return cells[1:]


def _check_extras(path: Path, space: Space) -> None:
    """InputError if named planes or single combinations have too many cells."""
    parts = [
        (f"planes.{named.name}", named.variables, named.strength) for named in space.extras.planes
    ]
    single = space.extras.combinations
    parts += [
        (f"combinations[{i}]", one.variables, len(one.variables))
        for i, one in enumerate(single, start=1)
    ]
    for key, variables, strength in parts:
        if (cells := _cells([space.sizes[v] for v in variables], strength)[-1]) > MOST_CELLS:
            raise InputError(
                f"{path}: {key}: about {cells:.2g} cells are more than the {MOST_CELLS:.0e} that fit; choose fewer conditions"
            )


def _combined(space: Space, strength: int) -> str:
    """What a plan combines, in words."""
    *parts, last = (
        f"{strength} conditions",
        *(f"{named.strength} of {named.name}" for named in space.extras.planes),
    )
    single = len(space.extras.combinations)
    return (
        (f"{', '.join(parts)} and " if parts else "")
        + last
        + (f", and {single} single ones" if single else "")
    )


def _with(space: Space) -> str:
    return " with named planes and combinations" if space.extras else ""


def _total(path: Path, every: Iterable[Plane]) -> Coverage:
    try:
        return total(every)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def _draw(
    options: argparse.Namespace,
    space: Space,
    shares: list[tuple[int, float]],
    pairs: list[Plane] | None,
) -> list[Path]:
    from pipeline.report import coverage_plots as plots
    from pipeline.report.style import save_png

    paths = [options.figures / "growth.png"]
    save_png(plots.growth(shares, options.k), paths[0])
    if pairs is not None:
        paths.append(options.figures / "planes.png")
        save_png(plots.heat_maps(pairs, space), paths[1])
    return paths


def _announce_compilation() -> None:
    """Say why the first call on a machine takes longer."""
    from numba import config

    cached = Path(config.CACHE_DIR or Path(arrays.__file__).parent / "__pycache__")
    if not any(cached.rglob("annealing.*.nbi")) or not any(cached.rglob("counting.*.nbi")):
        print(
            f"compiling the kernels of {counting.__package__}, once on this machine …",
            file=sys.stderr,
            flush=True,
        )


VERBS: Mapping[str, Callable[[argparse.Namespace, Progress], tuple[Found, str]]] = {
    verb.__name__: verb for verb in (score, propose, plan, verify, export)
}
