"""Why the tests of a region fail: its failures as executed and with single changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import pandas as pd

from pipeline.analysis.region_sentence import sentence
from pipeline.artefacts.region_results import FailureRegion, Repair, Seen, Why
from pipeline.artefacts.results import Estimate
from pipeline.artefacts.tables import UNCHANGED, is_valid
from pipeline.core.counted import Counted
from pipeline.core.sight import sight
from pipeline.core.signals import Signals
from pipeline.scenarios.changes import CONTROL, Change, ranked


def recorded(
    region: FailureRegion, tests: pd.DataFrame, signals: Mapping[str, Signals]
) -> list[dict[str, Any]]:
    """The rows of a region's failures as their campaigns executed them.

    Args:
        region: The region.
        tests: Rows of tests.parquet, indexed by test_id.
        signals: test_id -> its signals.
    """
    rows: list[dict[str, Any]] = []
    for test in region.members:
        row = {"region": region.name, "change": UNCHANGED, "status": "ok", "reason": ""}
        adjusted_s = float(tests.loc[test, "adj_ttc_s"])
        outcome = {"failure": True, "test_id": test, "adj_ttc_s": adjusted_s}
        rows.append({**row, **outcome, **asdict(sight(signals[test]))})
    return rows


def explained(
    region: FailureRegion, changes: Sequence[Change], rows: pd.DataFrame, confidence: float
) -> FailureRegion:
    """The region with its `why`.

    Args:
        region: The region.
        changes: Single changes in the order of their declaration, which breaks ties.
        rows: Rows of `pipeline.artefacts.tables.WHY`.
        confidence: Confidence of the intervals, in (0, 1).
    """
    of_region = rows[rows["region"] == region.name]
    seen = _seen(of_region[of_region["change"] == UNCHANGED])
    executed, effects = {}, []
    for change in changes:
        repair = _repair(change, of_region[of_region["change"] == change.text], confidence)
        if repair.tests or repair.errors:
            executed[change.text] = repair
            if not change.is_control:
                effects.append((change, repair.repaired))
    repairs = [executed[change.text] for change in ranked(effects)]
    control = executed.get(CONTROL.text)
    why = Why(
        sentence=sentence(region.conditions, seen, repairs, control),
        seen=seen,
        confidence=confidence,
        repairs=tuple(repairs),
        control=control,
    )
    return region.model_copy(update={"why": why})


def _repair(change: Change, rows: pd.DataFrame, confidence: float) -> Repair:
    counted = Counted.of(~rows["failure"].to_numpy(bool), (~is_valid(rows)).to_numpy(bool))
    return Repair(
        change=change.text,
        values=dict(change.values),
        without=change.without,
        tests=counted.tests,
        repaired=counted.failures,
        errors=counted.errors,
        rate=Estimate.of(counted, confidence),
    )


def _seen(rows: pd.DataFrame) -> Seen:
    both = rows[rows["first_sight_s"].notna() & rows["first_detection_s"].notna()]
    return Seen(
        failures=len(rows),
        in_sight=int(rows["first_sight_s"].notna().sum()),
        detected=int(rows["first_detection_s"].notna().sum()),
        first_sight_m=_median(rows["first_sight_m"]),
        first_sight_pixels=_median(rows["first_sight_pixels"]),
        first_sight_contrast=_median(rows["first_sight_contrast"]),
        last_chance_pixels=_median(rows["last_chance_pixels"]),
        last_chance_contrast=_median(rows["last_chance_contrast"]),
        first_detection_m=_median(both["first_detection_m"]),
        delay_s=_median(both["first_detection_s"] - both["first_sight_s"]),
    )


def _median(values: pd.Series) -> float | None:
    return None if values.isna().all() else float(values.median())
