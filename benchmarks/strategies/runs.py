"""Runs campaigns in processes and keeps one JSON line of each, so that the same command does only what is missing.

Runs that the repository publishes lie in `KEPT`, a table for each group of worlds.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import contestants
import numpy as np
import pandas as pd
import recorded
import worlds
from campaigns import Row, Run, execute
from worlds import WorldName

from pipeline.progress import Progress
from pipeline.sources import code_digest

CODE = ("analytic", "campaigns", "ceiling", "emulators", "recorded", "scores", "worlds")
"""Files of this folder, and modules of the package, that decide what a run gives, whatever its strategy."""
MODULES = (
    "pipeline.core.density",
    "pipeline.core.measures",
    "pipeline.core.samplers.features",
    "pipeline.core.samplers.mutations",
)

DIGITS = 6
"""Decimals of a measure: unpublished and published runs give the same tables."""
KEPT = Path(__file__).parent / "results"


def run_all(runs: Iterable[Run], path: Path, processes: int, progress: Progress) -> None:
    """Execute the runs that have no line of the present code, settings and recorded tests, and append a line for each."""
    done = {(_key(row), row["digest"]) for row in read(path)}
    missing = [run for run in runs if (_key(asdict(run)), digest(run)) not in done]
    path.parent.mkdir(parents=True, exist_ok=True)
    _end_last_line(path)
    with path.open("a") as file:
        for count, row in enumerate(_executed(missing, processes), 1):
            rounded = {
                key: round(value, DIGITS) if isinstance(value, float) else value
                for key, value in row.items()
            }
            file.write(json.dumps({**rounded, "digest": digest(Run(*_key(row)))}) + "\n")
            file.flush()
            text = f"{row['strategy']} on {row['world']}, seed {row['seed']}: {len(row['failed_at'])} failures"
            progress(count, len(missing), text)


def read(path: Path, kept: Path = KEPT) -> list[Row]:
    """The newest line of each run, sorted; those of the file count after those in the repository, a line cut short by a kill not at all."""
    newest = {
        _key(row): row
        for table in sorted(kept.glob(f"{path.stem}-*.csv.gz"))
        for row in _kept(table)
    }
    for line in path.read_text().splitlines() if path.exists() else []:
        try:
            row = json.loads(line)
        except ValueError:
            continue
        newest[_key(row)] = row
    return [newest[key] for key in sorted(newest)]


def keep(path: Path, kept: Path = KEPT) -> list[Path]:
    """Publish the rows of `read`, a table for each group of worlds; equal rows give equal bytes."""
    groups: dict[str, list[Row]] = {}
    for row in read(path, kept):
        marks = np.isin(np.arange(1, row["tests"] + 1), row["failed_at"])
        groups.setdefault(WorldName.parse(row["world"]).group, []).append(
            {**row, "failed_at": np.packbits(marks).tobytes().hex()}
        )
    paths = []
    for group, rows in groups.items():
        paths.append(kept / f"{path.stem}-{group}.csv.gz")
        recorded.write(pd.DataFrame(rows), paths[-1])
    return paths


def _kept(path: Path) -> Iterator[Row]:
    for row in pd.read_csv(path, dtype={"failed_at": str}).to_dict("records"):
        marks = np.unpackbits(np.frombuffer(bytes.fromhex(row["failed_at"]), np.uint8))
        yield {**row, "failed_at": (np.flatnonzero(marks) + 1).tolist()}


@cache
def digest(run: Run) -> str:
    """SHA-256 of what a run depends on, beside its own fields."""
    parts = [_code(), contestants.digest(run.strategy), worlds.digest(WorldName.parse(run.world))]
    return hashlib.sha256("".join(parts).encode()).hexdigest()


@cache
def _code() -> str:
    own = b"".join((Path(__file__).parent / f"{name}.py").read_bytes() for name in CODE)
    return hashlib.sha256(own).hexdigest() + "".join(map(code_digest, MODULES))


def _executed(runs: Sequence[Run], processes: int) -> Iterator[Row]:
    if processes == 1:
        yield from map(execute, runs)
        return
    os.environ["OMP_NUM_THREADS"] = (
        "1"  # Read by the spawned processes when they load their libraries.
    )
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(execute, run) for run in runs]):
            yield future.result()


def _key(row: Row) -> tuple[Any, ...]:
    return row["world"], row["strategy"], row["seed"], row["tests"]


def _end_last_line(path: Path) -> None:
    """End a line that a kill cut short, so that the next one is whole."""
    if path.exists() and (text := path.read_bytes()) and not text.endswith(b"\n"):
        path.write_bytes(text + b"\n")
