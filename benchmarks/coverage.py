"""Coverage and covering arrays: sizes, counting, large tables, feasible cells, proposals.

    python -m benchmarks.coverage [arrays] [sizes] [counting] [tables] [cells] [proposals]
                                  [--cpu-seconds 60] [--models FOLDER] [--only NAME ...]

`arrays` makes covering arrays, checks them and publishes their sizes; `sizes` prints the table of
docs/results/coverage.md. `other tools` is the best default size of PICT, jenny, allpairspy,
coverwise, testflows-combinatorics and covertable, or of ACTS under constraints, measured once.
`best known` is the smallest published size, or a lower bound that is reached. --models: a folder of
space files, whose published sizes are looked up by name.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Collection
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from benchmarks.shared import RESULTS, markdown
from pipeline.artefacts.space_file import read_space_file
from pipeline.config.composing import compose
from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage.arrays import CoveringArray, Effort, covering_array
from pipeline.core.coverage.counting import CellCounts
from pipeline.core.coverage.projection import Demand
from pipeline.core.coverage.proposals import Proposer
from pipeline.core.coverage.verification import verify

SPACES: dict[str, tuple[tuple[int, ...], int, int, int]] = {
    "3^4": ((3,) * 4, 2, 9, 9),
    "3^13": ((3,) * 13, 2, 17, 15),
    "4^15 3^17 2^29": ((4,) * 15 + (3,) * 17 + (2,) * 29, 2, 36, 29),
    "4^1 3^39 2^35": ((4,) + (3,) * 39 + (2,) * 35, 2, 27, 21),
    "2^100": ((2,) * 100, 2, 15, 10),
    "10^20": ((10,) * 20, 2, 197, 180),
    "4^10": ((4,) * 10, 2, 29, 24),
    "5^10": ((5,) * 10, 2, 45, 36),
    "6^10": ((6,) * 10, 2, 62, 53),
    "2^20, t = 3": ((2,) * 20, 3, 25, 18),
    "3^10, t = 3": ((3,) * 10, 3, 0, 45),
    "3^8, t = 4": ((3,) * 8, 4, 0, 135),
    "5^10, t = 3": ((5,) * 10, 3, 291, 185),
    "4^20, t = 3": ((4,) * 20, 3, 0, 127),
    "5^30, t = 3": ((5,) * 30, 3, 0, 249),
    "4^12, t = 4": ((4,) * 12, 4, 0, 0),
    "thesis without blueprint": ((11, 11, 12, 12, 11, 13, 6), 2, 185, 156),
    "the same, 13 azimuths": ((11, 11, 13, 12, 11, 13, 6), 2, 193, 169),
    "thesis": ((11, 11, 12, 12, 11, 13, 6, 74), 2, 962, 962),
}
"""Sizes, strength, others, best."""
KNOWN_SIZES = {
    "spins": (26, 19),
    "bugzilla": (19, 16),
    "apache": (33, 30),
    "banking1": (15, 13),
    "telecom": (32, 30),
    "services": (0, 100),
    "healthcare3": (0, 34),
    "gcc": (0, 16),
    "spinv": (0, 31),
}
"""ACTS 2.92 and the best of FastCA."""
NAMES = ("sunny", "cloudy", "rainy", "foggy")
TABLE_PIECE = 250_000
"""Rows that are made at a time."""
PUBLISHED = RESULTS / "coverage.csv"


def arrays(seconds: float, models: Path | None, only: Collection[str]) -> None:
    """Publish sizes: quick, and polished for so many seconds of processor time."""
    problems = []
    for name, (sizes, strength, others, best) in SPACES.items():
        problems.append((name, Constraints(sizes), strength, others, best))
    for path in sorted(models.glob("*.yaml")) if models else []:
        limits = read_space_file(path).constraints
        problems.append((path.stem, limits, 2, *KNOWN_SIZES.get(path.stem, (0, 0))))
    for clauses in ((), ((Literal(0, 0), Literal(1, 0)),)):
        covering_array(Constraints((2, 2, 2, 2), clauses), 2, effort=Effort(0.1))  # Compiles.
    for name, limits, strength, others, best in problems:
        if only and name not in only:
            continue
        begin = time.process_time()
        quick = covering_array(limits, strength)
        quick_s = time.process_time() - begin
        polished, reached_s = polish(limits, strength, seconds)
        for array in (quick, polished):
            checked = verify(array.rows, limits, strength)
            assert checked.valid and checked.cells == array.cells, name
        row = {"space": name, "cells": quick.cells, "others": others, "best": best}
        row |= {"bound": polished.lower_bound, "quick": quick.size, "quick_s": round(quick_s, 2)}
        row |= {"polished": polished.size, "reached_s": round(reached_s, 1), "limit_s": seconds}
        print(row, flush=True)
        publish(row, [problem[0] for problem in problems])


def polish(limits: Constraints, strength: int, seconds: float) -> tuple[CoveringArray, float]:
    """The polished array, and the processor time after which it had its size."""
    begin, last = time.process_time(), [0, 0.0]

    def report(share: float, size: int, bound: int) -> None:
        if size != last[0]:
            last[:] = size, time.process_time() - begin

    array = covering_array(limits, strength, effort=Effort(seconds, report, processor=True))
    return array, last[1] if last[0] == array.size else time.process_time() - begin


def publish(row: dict[str, object], order: list[str]) -> None:
    """Put a row in the place of the one of the same space, in the given order of spaces."""
    earlier = pd.read_csv(PUBLISHED).to_dict("records") if PUBLISHED.exists() else []
    rows = [*(other for other in earlier if other["space"] != row["space"]), row]
    places = {name: place for place, name in enumerate(order)}
    rows.sort(key=lambda each: places.get(each["space"], len(order)))
    pd.DataFrame(rows).to_csv(PUBLISHED, index=False)


def sizes() -> None:
    """Print the published sizes as the page's table."""
    names = ("space", "cells", "other tools", "best known", "bound", "quick", "seconds")
    rows = []
    for row in pd.read_csv(PUBLISHED).itertuples():
        sizes = (row.others or "", row.best or "", row.bound, row.quick)
        times = (f"{row.quick_s:.2f}", row.polished, f"{row.reached_s:.1f} s")
        rows.append((row.space, f"{row.cells:,}", *sizes, *times, f"{row.limit_s:.0f} s"))
    print(markdown((*names, "polished", "reached after", "limit"), rows))


def counting() -> None:
    """All counts of a million points, 50 conditions of four values, k = 3."""
    points = np.random.default_rng(0).integers(0, 4, (1_000_000, 50))
    CellCounts((4,) * 50, 3).add(points[:5000])  # Compiles.
    begin = time.perf_counter()
    CellCounts((4,) * 50, 3).add(points)
    ours = time.perf_counter() - begin
    columns = np.ascontiguousarray(points.T.astype(np.uint8))
    planes, begin = list(combinations(range(50), 3)), time.perf_counter()
    for i, j, k in planes[:40]:
        np.bincount(columns[i] * np.uint8(16) + columns[j] * np.uint8(4) + columns[k], minlength=64)
    theirs = (time.perf_counter() - begin) / 40 * len(planes)
    bincount = f"numpy.bincount {theirs:.0f} s (from 40 planes), {theirs / ours:.0f} times"
    print(f"counting 10^6 x 50 x 4 values, k = 3: {ours:.2f} s on one core; {bincount}")


def tables() -> None:
    """Time and largest memory of `coverage score` on tables of 50 conditions of four names."""
    for rows, suffix in ((10**6, "parquet"), (10**6, "csv"), (10**7, "parquet")):
        with TemporaryDirectory() as folder:
            space, table = Path(folder) / "space.yaml", Path(folder) / f"points.{suffix}"
            lines = [f"  c{i}: {{values: {[*NAMES]}}}\n" for i in range(50)]
            space.write_text("variables:\n" + "".join(lines))
            write_names(table, rows)
            command = [sys.executable, "-m", "pipeline", "coverage", "score", "--k", "3"]
            command += ["--space", str(space), "--points", str(table)]
            begin = time.perf_counter()
            process = subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            _, code, used = os.wait4(process.pid, 0)
            seconds, megabytes = time.perf_counter() - begin, used.ru_maxrss / 1024
            if code:
                raise SystemExit(f"{' '.join(command)}: ended with {code}")
            print(
                f"score of {rows:,} rows of 50 names, {suffix}: {seconds:.1f} s, "
                f"{used.ru_utime:.1f} s of processor time, {megabytes:.0f} MB"
            )


def write_names(path: Path, rows: int) -> None:
    """Write a table of 50 columns of random names, in pieces."""
    rng, columns = np.random.default_rng(0), [f"c{i}" for i in range(50)]
    schema = pa.schema([(column, pa.string()) for column in columns])
    open_writer = pq.ParquetWriter if path.suffix == ".parquet" else pa_csv.CSVWriter
    with open_writer(path, schema) as writer:
        for _ in range(rows // TABLE_PIECE):
            places = rng.integers(0, len(NAMES), (50, TABLE_PIECE))
            arrays = [pa.array(NAMES).take(pa.array(row)) for row in places]
            writer.write_table(pa.table(arrays, schema))


def cells() -> None:
    """Feasible pairs of 50 conditions with 100 random clauses of three literals."""
    rng = random.Random(1)
    for values in (2, 4):
        clauses = []
        for _ in range(100):
            chosen = rng.sample(range(50), 3)
            clause = [Literal(v, rng.randrange(values), rng.random() < 0.5) for v in chosen]
            clauses.append(tuple(clause))
        constraints, begin = Constraints((values,) * 50, tuple(clauses)), time.perf_counter()
        pairs = combinations(range(50), 2)
        feasible = sum(int(constraints.feasible_cells(pair).sum()) for pair in pairs)
        milliseconds = 1000 * (time.perf_counter() - begin)
        print(
            f"feasible pairs, 50 conditions of {values} values: {feasible} in {milliseconds:.0f} ms"
        )


def proposals() -> None:
    """A proposal at n = 50, k = 2 against the exact solver's; the paper's domain by batches."""
    limits = Constraints((4,) * 50)
    proposer, rows = Proposer(Demand(limits, 2)), covering_array(limits).rows
    proposer.propose(rows[:5])  # Compiles.
    for points in (0, 10, 25):
        begin = time.perf_counter()
        quick = proposer.propose(rows[:points])
        milliseconds = 1000 * (time.perf_counter() - begin)
        exact = proposer.propose_exact(rows[:points], time_limit_s=20)
        assert quick is not None and exact is not None
        print(
            f"proposal, 50 conditions, {points} points: {quick.gain} in {milliseconds:.0f} ms; "
            f"after 20 s of HiGHS {exact.gain}, at most {exact.bound}"
        )
    domain = compose("front_car", []).front_car.space
    every, front = domain.feasible_points(), Proposer(Demand(domain.space().constraints, 2))
    batches, single, slowest = [], [], 0.0
    for seed in range(20):
        drawn = every[np.random.default_rng(seed).choice(len(every), 5, replace=False)]
        begin = time.perf_counter()
        front.propose_exact(drawn)
        slowest = max(slowest, time.perf_counter() - begin)
        single.append(sum(1 for _ in front.complete(drawn, exact=True)))
        batches.append(fewest(front, drawn))
    print(
        f"front-car domain, 20 draws of 5 points: an exact proposal takes at most "
        f"{1000 * slowest:.0f} ms; to full coverage {np.mean(single):.1f} points one by one, "
        f"{np.mean(batches):.1f} (at most {max(batches)}) in a batch; "
        f"from nothing {fewest(front, every[:0])}"
    )


def fewest(proposer: Proposer, points: np.ndarray) -> int:
    """Points that a batch needs for full coverage."""
    missing = int(proposer.missing(points).sum())
    for size in range(1, 20):
        batch = proposer.propose(points, size)
        if batch is not None and batch.gain == missing:
            return size
    raise ValueError("expected full coverage by at most 19 points")


def main() -> None:
    """Run the parts that are named, or all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts: dict[str, Callable[[], None]] = {
        "sizes": sizes,
        "counting": counting,
        "tables": tables,
        "cells": cells,
        "proposals": proposals,
    }
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"arrays, {', '.join(parts)} (default: all)"
    )
    parser.add_argument(
        "--cpu-seconds",
        type=float,
        default=60.0,
        help="processor time to polish an array (default: %(default)s)",
    )
    parser.add_argument("--models", type=Path, help="folder of space files")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help="arrays: only these spaces"
    )
    options = parser.parse_args()
    parts = {"arrays": lambda: arrays(options.cpu_seconds, options.models, options.only), **parts}
    for part in options.parts or parts:
        if part not in parts:
            parser.error(f"there is no part '{part}'; there are {', '.join(parts)}")
        parts[part]()


if __name__ == "__main__":
    main()
