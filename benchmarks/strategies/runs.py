"""Runs campaigns in processes and keeps one JSON line of each, so that the same command does only what is missing."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import ceiling
import contestants
import numpy as np
import worlds
from scores import scores
from threadpoolctl import threadpool_limits
from worlds import World, WorldName

from pipeline.core.space import Floats
from pipeline.progress import Progress

Row = dict[str, Any]
CODE = ("analytic", "ceiling", "emulators", "recorded", "runs", "scores", "worlds")


@dataclass(frozen=True)
class Run:
    """One campaign. strategy: see `contestants.make`. seed: of the strategy and of the world, so strategies are paired by it."""

    world: str
    strategy: str
    seed: int
    tests: int


def execute(run: Run) -> Row:
    """The row of a campaign: the run, `cpu_s` that the strategy itself took, and what `scores` gives."""
    study, name = worlds.default_study(), WorldName.parse(run.world)
    world, threshold_s = worlds.make(name, run.seed), study.campaign.failure_threshold_s
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if run.strategy == contestants.CEILING:
            points, spent = ceiling.greedy(world.space, ceiling.known_failures(world, threshold_s), run.tests), 0.0
            points = np.concatenate([points, world.space.sample(run.tests - len(points), np.random.default_rng(run.seed))])
            kpi = world.kpi(points)
        else:
            points, kpi, spent = search(world, run)
    regions = study.regions
    found = scores(world.space, points, kpi, threshold_s, regions.chance_neighbours, regions.min_failures)
    return {**asdict(run), "digest": digest(run), "cpu_s": spent, **found}


def search(world: World, run: Run) -> tuple[Floats, Floats, float]:
    """Points (n, d) and KPI (n,) of a campaign in order, and the CPU-seconds that asking and telling took."""
    started = time.process_time()
    sampler = contestants.make(run.strategy, world.space, run.seed)
    spent = time.process_time() - started
    points, kpi = np.zeros((0, len(world.space))), np.zeros(0)
    while len(kpi) < run.tests:
        started = time.process_time()
        asked = sampler.ask()
        spent += time.process_time() - started
        values = world.kpi(asked)
        started = time.process_time()
        sampler.tell(asked, values)
        spent += time.process_time() - started
        points, kpi = np.concatenate([points, asked]), np.concatenate([kpi, values])
    return points[: run.tests], kpi[: run.tests], spent


def run_all(runs: Iterable[Run], path: Path, processes: int, progress: Progress) -> None:
    """Execute the runs that have no line of the present code, settings and recorded tests, and append a line for each."""
    done = {(_key(row), row["digest"]) for row in read(path)}
    missing = [run for run in runs if (_key(asdict(run)), digest(run)) not in done]
    path.parent.mkdir(parents=True, exist_ok=True)
    _end_last_line(path)
    with path.open("a") as file:
        for count, row in enumerate(_executed(missing, processes), 1):
            file.write(json.dumps(row) + "\n")
            file.flush()
            text = f"{row['strategy']} on {row['world']}, seed {row['seed']}: {len(row['failed_at'])} failures"
            progress(count, len(missing), text)


def read(path: Path) -> list[Row]:
    """The newest line of each run; a line that a kill cut short is left out."""
    newest: dict[tuple[Any, ...], Row] = {}
    for line in path.read_text().splitlines() if path.exists() else []:
        try:
            row = json.loads(line)
        except ValueError:
            continue
        newest.pop(_key(row), None)
        newest[_key(row)] = row
    return list(newest.values())


@cache
def digest(run: Run) -> str:
    """SHA-256 of what a run depends on, beside its own fields."""
    own = b"".join((Path(__file__).parent / f"{name}.py").read_bytes() for name in CODE)
    parts = [own, contestants.digest(run.strategy).encode(), worlds.digest(WorldName.parse(run.world)).encode()]
    return hashlib.sha256(b"".join(parts)).hexdigest()


def _executed(runs: Sequence[Run], processes: int) -> Iterator[Row]:
    if processes == 1:
        yield from map(execute, runs)
        return
    os.environ["OMP_NUM_THREADS"] = "1"  # Read by the spawned processes when they load their libraries.
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(execute, run) for run in runs]):
            yield future.result()


def _key(row: Row) -> tuple[Any, ...]:
    return row["world"], row["strategy"], row["seed"], row["tests"]


def _end_last_line(path: Path) -> None:
    """End a line that a kill cut short, so that the next one is whole."""
    if path.exists() and (text := path.read_bytes()) and not text.endswith(b"\n"):
        path.write_bytes(text + b"\n")
