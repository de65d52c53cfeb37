"""Stored tests judged with another car, and driven again where it would have braked otherwise."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import pandas as pd

from pipeline.analysis.rescoring import driven_otherwise, kpis, rescored
from pipeline.artefacts.points import concrete
from pipeline.artefacts.tables import read_detections, read_signals, read_tests
from pipeline.core.car import Car
from pipeline.core.space import Space
from pipeline.execution.points import Executor


@dataclass(frozen=True)
class Again:
    """tests: rows of tests.parquet, judged with another car but driven as they were.

    others: test_id of those that it drives otherwise.
    """

    tests: pd.DataFrame
    others: tuple[str, ...]


def judged_again(folder: Path, car: Car, failure_threshold_s: float) -> Again:
    """Judge the tests of a campaign's folder with another car.

    Tests that ended in an error stay errors.
    """
    tests, signals = (
        read_tests(folder / "tests.parquet").set_index("test_id"),
        read_signals(folder / "signals.parquet"),
    )
    again = rescored(signals, read_detections(folder / "detections.parquet"), car)
    judged = kpis(again, failure_threshold_s)
    tests.loc[judged.index, judged.columns] = judged.astype(tests[judged.columns].dtypes.to_dict())
    return Again(tests.reset_index(), tuple(driven_otherwise(signals, again)))


def driven_again(
    again: Again, space: Space, failure_threshold_s: float, executor: Executor
) -> pd.DataFrame:
    """The tests, with those that the car drives otherwise executed again."""
    rows = again.tests.set_index("test_id")
    points = [concrete(rows.loc[test], space) for test in again.others]
    for test, outcome in zip(again.others, executor.outcomes(points), strict=True):
        now = {
            "status": outcome.status,
            "reason": outcome.reason,
            **asdict(outcome.kpi(failure_threshold_s)),
        }
        rows.loc[test, list(now)] = list(now.values())
    return rows.reset_index()[list(again.tests)]
