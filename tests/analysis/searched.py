"""A searched world of known truth: two failure regions, one of them where no search looks."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pandas as pd

from pipeline.analysis.evidence import Searched
from pipeline.artefacts.failure_counts import Count, Modes
from pipeline.artefacts.region_results import (
    FailureRegion,
    FailureRegions,
    Representative,
    RuleCondition,
)
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.core.space import Floats, Space, Variable

SPACE = Space(
    (Variable("x", "continuous", "m", 0, 10, 2), Variable("y", "continuous", "m", 0, 10, 2))
)
CONDITION = RuleCondition(variable="x", text="x <= 2 m", low=0, high=2)
"""The search finds this region, a fifth of the space."""
HIDDEN = 0.06
"""Share of a second failure region, where the search never looks."""


def fails(points: Floats) -> np.ndarray:
    """Which points are in one of the two regions."""
    return np.asarray((points[:, 0] <= 2) | (points[:, 0] >= 10 - 10 * HIDDEN))


def rows(strategy: str, points: Floats) -> pd.DataFrame:
    """The tests of a strategy at these points."""
    failed = fails(points)
    table = pd.DataFrame(
        {
            "strategy": strategy,
            "status": "ok",
            "failure": failed,
            "cause": np.where(failed, "box", "none"),
        }
    )
    return table.assign(
        test_id=[f"{strategy}-{i}" for i in range(len(points))], x=points[:, 0], y=points[:, 1]
    )


def world(
    random: int,
    searched: int,
    seed: int = 0,
    status: Literal["confirmed", "not confirmed"] = "not confirmed",
) -> Searched:
    """Random tests, and as many of a search that never looks beyond x = 8."""
    rng = np.random.default_rng(seed)
    looks = SPACE.sample(searched, rng) * [0.8, 1.0]
    tests = pd.concat(
        [rows("random", SPACE.sample(random, rng)), rows("mixed", looks)], ignore_index=True
    )
    medoid = Representative(
        test_id="mixed-0", role="medoid", strategy="mixed", seed=0, adj_ttc_s=0.0, concrete={}
    )
    region = FailureRegion(
        name="one",
        cause="box",
        members=("mixed-0",),
        modes=Modes(),
        strategies={},
        rule="x <= 2 m",
        conditions=(CONDITION,),
        support=1,
        failures_inside=1,
        precision=1,
        lift=1,
        recall=1,
        held_back=Count(tests=0, failures=0),
        status=status,
        representatives=(medoid,),
    )
    regions = FailureRegions(
        scenario="S",
        label="S",
        tests=1,
        failures=1,
        failure_rate=1,
        connected=1,
        regions=(region,),
        isolated=(),
        not_solvable=(),
    )
    return Searched(ScenarioInfo("S", "S", "", 0), SPACE, tests, regions, frozenset({"random"}))
