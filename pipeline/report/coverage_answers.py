"""The answers of `coverage` to score, propose, plan, verify and export, for --json and as text.

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
    Answer,
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
from pipeline.report.coverage_texts import (
    SHOWN,
    cell_text,
    imperfect,
    imperfect_text,
    propose_text,
    row_text,
    score_text,
)

# Solvers are imported where they are used: importing them takes longer than counting a table of a
# hundred thousand points.
if TYPE_CHECKING:
    from pipeline.core.coverage.proposals import Proposal, Proposer

MOST_CELLS = 200_000_000


def score(options: argparse.Namespace, progress: Progress) -> tuple[Answer, str]:
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
    every = [list(planes(cells, wanted)) for cells, wanted in zip(counts, demands, strict=True)]
    by_k = []
    for k, of_strength in enumerate(every[len(pairs) : len(pairs) + options.k], 1):
        by_k.append({"k": k, **fraction(_total(options.space, of_strength))})
    coverage = _total(options.space, every[-1])
    missing = coverage.covered < coverage.required
    progress(1, 1, f"{table.points:,} points")
    answer: Answer = {
        **fraction(coverage),
        "k": options.k,
        "operator": options.operator,
        **imperfect(table),
        "by_k": by_k,
        **of_extras(space, every[-1]),
        **details(space, every[-1]),
        "next": next_points(space, raising.points, demands[-1]) if missing else [],
    }
    if options.figures:
        from pipeline.report import coverage_plots as plots
        from pipeline.report.style import save_png

        figures = {"growth": plots.growth(growth(raising, coverage), options.k)}
        if pairs:
            figures["planes"] = plots.heat_maps(every[0], space)
        answer["figures"] = [str(options.figures / f"{name}.png") for name in figures]
        for name, figure in figures.items():
            save_png(figure, options.figures / f"{name}.png")
    return answer, "\n".join([*imperfect_text(answer), score_text(answer, space)])


def propose(options: argparse.Namespace, progress: Progress) -> tuple[Answer, str]:
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
    proposal, needed = _proposal(proposer, rows, options)
    points = proposal.categories
    after = _total(options.space, planes_of(np.vstack([rows, points]), demand))
    progress(1, 1, f"{after.covered} of {after.required} covered")
    if options.output:
        write_points(options.output, space, points)
    answer: Answer = {
        "count": len(points),
        "needed_at_least": needed,
        "k": options.k,
        "operator": options.operator,
        "gain": proposal.gain,
        "bound": proposal.bound,
        "gap": proposal.bound - proposal.gain,
        "optimal": len(points) == needed if options.complete else proposal.optimal,
        "before": fraction(before),
        "after": fraction(after),
        "points": space.names_of(points),
        "existing": existing,
    }
    extras = " with named planes and combinations" if space.extras else ""
    name = f"{options.k}-projection coverage{extras}"
    text = propose_text(answer, options.complete, options.heavy_first, name, before, after)
    return answer, "\n".join([*(imperfect_text(existing) if existing else []), text])


def _proposal(proposer: Proposer, rows: Ints, options: argparse.Namespace) -> tuple[Proposal, int]:
    """The proposed points, none if nothing is missing, and a bound on a complete set of points."""
    from pipeline.core.coverage.proposals import Proposal

    if options.complete:
        completion = proposer.completion(rows)
        added = completion.categories
        gain = int((proposer.missing(rows) - proposer.missing(np.vstack([rows, added]))).sum())
        return Proposal(added, gain, gain), completion.bound
    proposal = (
        proposer.propose_exact(rows, options.count, options.seconds)
        if options.exact
        else proposer.propose(rows, options.count)
    )
    return proposal or Proposal(rows[:0], 0, 0), proposer.fewest(rows)


def plan(options: argparse.Namespace, progress: Progress) -> tuple[Answer, str]:
    """A covering array: few points that cover all combinations of `strength` conditions."""
    from pipeline.core.coverage.certified import certified_array

    space = _read_space(options, "strength")
    seeds = None if options.include is None else read_points(options.include, space).strict()
    started = time.monotonic()
    _announce_compilation()

    def report(share: float, size: int, bound: int) -> None:
        progress(min(999, int(1000 * share)), 1000, f"{size} points, at least {bound} needed")

    limit = options.seconds if options.cpu_seconds is None else options.cpu_seconds
    effort = Effort(
        (limit or None) if options.effort == "polish" else None,
        report,
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
    answer: Answer = {
        "size": array.size,
        "lower_bound": array.lower_bound,
        "gap": array.size - array.lower_bound,
        "optimal": array.size == array.lower_bound,
        "cells": array.cells,
        "strength": options.strength,
        "effort": options.effort,
        "seconds": round(time.monotonic() - started, 3),
    }
    certainty = f"no plan has fewer than {array.lower_bound}"
    if answer["optimal"]:
        certainty = "this is the smallest possible number"
    combined = f"{array.cells:,} feasible combinations of {_combined(space, options.strength)}"
    return answer, f"{array.size} points cover all {combined}; {certainty}."


def verify(options: argparse.Namespace, progress: Progress) -> tuple[Answer, str]:
    """Check a plan independently of the code that makes plans."""
    space = _read_space(options, "strength")
    table = read_points(options.points, space)
    rows = table.complete()
    checked = verify_rows(rows, space.constraints, Mixed(options.strength, space.extras), progress)
    broken = []
    for row, clause in checked.broken:
        constraint = f"row {row + 1} breaks the constraint '{space.clause(clause)}'"
        broken.append(f"{constraint}: {row_text(space, rows[row])}")
    missing = [cell_names(space, plane, cell) for plane, cell in checked.missing[:LISTED]]
    answer: Answer = {
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
    cells = f"{checked.cells:,} feasible combinations"
    if checked.valid:
        combined = _combined(space, options.strength)
        return answer, f"valid: {checked.rows} points cover all {cells} of {combined}"
    lines = [f"not valid: {line}" for line in broken[:SHOWN]]
    if missing:
        count = f"{len(checked.missing):,} of {cells}"
        lines.append(f"not valid: {count} are missing, among them")
        lines += [f"  {cell_text(cell)}" for cell in missing[:SHOWN]]
    return answer, "\n".join(lines)


def export(options: argparse.Namespace, progress: Progress) -> tuple[Answer, str]:
    """Write the space as another tool's model, or as a space file."""
    space, kind = read_space_of_any_format(options.space), format_of(options.output, options.format)
    left_out = write_model(options.output, space, kind)
    progress(1, 1, f"{len(space)} conditions")
    answer: Answer = {
        "format": kind,
        "conditions": len(space),
        "constraints": len(space.clauses),
        "left_out": left_out,
    }
    head = f"{options.output}: {len(space)} conditions, {len(space.clauses)} constraints"
    return answer, "\n".join([head, *(f"left out: {part}" for part in left_out)])


def _read_space(options: argparse.Namespace, option: str) -> Space:
    """The space of --space; InputError if --k or --strength does not fit it."""
    space, k = read_space_of_any_format(options.space), getattr(options, option)
    if not 1 <= k <= len(space):
        conditions = f"[1, {len(space)}], the number of conditions"
        raise InputError(f"--{option} must be in {conditions}; got {k}")
    if options.verb == "plan" and k > STRONGEST:
        raise InputError(f"--strength must be in [1, {STRONGEST}], got {k}")
    by_strength = _cells(space.sizes, k)
    cells = sum(by_strength) if options.verb == "score" else by_strength[-1]
    _check_cells(f"--{option} = {k}", cells, "a smaller one")
    for group in space.extras.planes:
        cells = _cells([space.sizes[v] for v in group.variables], group.strength)[-1]
        _check_cells(f"{options.space}: planes.{group.name}", cells, "fewer conditions")
    for number, combination in enumerate(space.extras.combinations, start=1):
        sizes = [space.sizes[v] for v in combination.variables]
        cells = _cells(sizes, len(sizes))[-1]
        _check_cells(f"{options.space}: combinations[{number}]", cells, "fewer conditions")
    return space


def _check_cells(key: str, cells: float, choice: str) -> None:
    """InputError if there are too many cells. choice: the remedy, in words."""
    if cells > MOST_CELLS:
        raise InputError(
            f"{key}: about {cells:.2g} cells are more than the {MOST_CELLS:.0e} that fit; choose "
            f"{choice}"
        )


def _cells(sizes: Sequence[int], k: int) -> list[float]:
    """Number of cells of all planes of 1 to k conditions: sums of products of k sizes."""
    cells = [1.0] + [0.0] * k
    for size in sizes:
        for strength in range(k, 0, -1):
            cells[strength] += cells[strength - 1] * size
    return cells[1:]


def _demand(options: argparse.Namespace, space: Space) -> Demand:
    """The demand of --k and --operator; InputError if the weights are too large for it."""
    try:
        return Demand(space.constraints, options.k, space.weights, options.operator, space.extras)
    except ValueError as error:
        raise InputError(f"{options.space}: {error}") from error


def _combined(space: Space, strength: int) -> str:
    """The combinations that a plan covers, in words."""
    groups = (f"{group.strength} of {group.name}" for group in space.extras.planes)
    *parts, last = (f"{strength} conditions", *groups)
    text = f"{', '.join(parts)} and {last}" if parts else last
    single = len(space.extras.combinations)
    return f"{text}, and {single} single ones" if single else text


def _total(path: Path, every: Iterable[Plane]) -> Coverage:
    try:
        return total(every)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def _announce_compilation() -> None:
    """Explain on stderr why the first call on a machine takes longer."""
    from numba import config

    cached = Path(config.CACHE_DIR or Path(arrays.__file__).parent / "__pycache__")
    if not any(cached.rglob("annealing.*.nbi")) or not any(cached.rglob("counting.*.nbi")):
        print(
            f"compiling the kernels of {counting.__package__}, once on this machine …",
            file=sys.stderr,
            flush=True,
        )


VERBS: Mapping[str, Callable[[argparse.Namespace, Progress], tuple[Answer, str]]] = {
    verb.__name__: verb for verb in (score, propose, plan, verify, export)
}
