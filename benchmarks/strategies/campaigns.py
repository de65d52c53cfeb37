"""One campaign of one strategy in one world."""

from __future__ import annotations

import time
import warnings
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import ceiling
import contestants
import numpy as np
import worlds
from scores import scores
from threadpoolctl import threadpool_limits
from worlds import World, WorldName

from pipeline.core.space import Floats

Row = dict[str, Any]


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
            points, spent = (
                ceiling.greedy(world.space, ceiling.known_failures(world, threshold_s), run.tests),
                0.0,
            )
            points = np.concatenate(
                [
                    points,
                    world.space.sample(run.tests - len(points), np.random.default_rng(run.seed)),
                ]
            )
            kpi = world.kpi(points)
        else:
            points, kpi, spent = search(world, run)
    regions = study.regions
    found = scores(
        world.space, points, kpi, threshold_s, regions.chance_neighbours, regions.min_failures
    )
    return {**asdict(run), "cpu_s": spent, **found}


def search(world: World, run: Run) -> tuple[Floats, Floats, float]:
    """Points (n, d) and KPI (n,) of a campaign in order, and the CPU-seconds that asking and telling took."""
    _warm(run.strategy, run.world)
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


@cache
def _warm(strategy: str, world: str) -> None:
    """Let a process compile and import what a strategy needs, which is no part of its time a test."""
    space = worlds.make(WorldName.parse(world), 0).space
    sampler = contestants.make(strategy, space, 0)
    for _ in range(2):
        asked = sampler.ask()
        sampler.tell(asked, np.linspace(0.2, 1, len(asked)))
