"""Selects kept frames for training.

They are of all tests or of failures, balanced over regions or causes, or weighted by the detector's
confidence in them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pandas as pd

from pipeline.analysis.failure_regions import cluster
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.artefacts.tables import is_valid
from pipeline.config.sections import Regions
from pipeline.core.space import Floats, Space

POOL = ["test_id", "step", "empty", "group", "scenario", "weight"]
"""Columns of a pool of frames.

empty: no visible pedestrian. group: rows are drawn in equal numbers from each. scenario: '' for
none. weight: how often a row is drawn, relative to others of its group."""
ANY = ""
"""The only group if nothing is balanced."""
LEAST = 0.05
"""Weight of frames that teach least, so that a pool never runs dry."""
WEIGHTS: Mapping[str, Callable[[Floats], Floats]] = {
    "unsure": lambda confidence: LEAST + 4 * confidence * (1 - confidence),
    "missed": lambda confidence: LEAST - np.log(np.maximum(confidence, LEAST)),
}
"""Selection -> weight of frames by the confidence of the searched version's detection, (n,).

`unsure`: the variance of a coin with that bias; `missed`: the log loss."""


def groups(
    selection: str,
    tests: pd.DataFrame,
    spaces: Mapping[str, tuple[ScenarioInfo, Space]],
    section: Regions,
) -> dict[str, str]:
    """Group the tests whose frames may be added.

    Args:
        selection: `all` tests; `failures`; `causes`: all tests, each cause a group and passing
            tests another; `regions`: failures, each region a group, plus a group per scenario for
            failures in no region. Those of `WEIGHTS` take all tests.
        tests: rows of all campaigns of a source.
        spaces: by scenario.
        section: settings of the regions.

    Returns:
        test_id -> group.
    """
    if selection == "all" or selection in WEIGHTS:
        return dict.fromkeys(tests["test_id"], ANY)
    if selection == "causes":
        return dict(zip(tests["test_id"], tests["cause"], strict=True))
    failed = tests[tests["failure"]]
    if selection == "failures":
        return dict.fromkeys(failed["test_id"], ANY)
    grouped: dict[str, str] = {}
    for scenario, rows in tests[is_valid(tests)].groupby("scenario"):
        info, space = spaces[str(scenario)]
        regions = cluster(info, space, rows.reset_index(drop=True), section)
        grouped |= dict.fromkeys(regions.isolated, f"{info.label}, isolated")
        for region in regions.regions:
            grouped |= dict.fromkeys(region.members, region.name)
    return grouped


def pool(
    judged: pd.DataFrame,
    grouped: Mapping[str, str],
    scenarios: Mapping[str, str],
    selection: str = "all",
) -> pd.DataFrame:
    """The frames that may be drawn, in a fixed order.

    Args:
        judged: rows of filter tables.
        grouped, scenarios: group and scenario by test.
        selection: as for `groups`.

    Returns:
        A table with the columns `POOL`.
    """
    rows = judged[judged["kept"] & judged["test_id"].isin(list(grouped))]
    ids = rows["test_id"]
    rows = rows.assign(
        empty=rows["visible_pixels"] == 0, group=ids.map(grouped), scenario=ids.map(scenarios)
    )
    weight: Floats | float = 1.0
    if selection in WEIGHTS:
        weight = WEIGHTS[selection](rows["confidence"].to_numpy(float))
    rows = rows.assign(weight=weight)[POOL]
    return rows.sort_values(["test_id", "step"], ignore_index=True)


def capacity(rows: pd.DataFrame, empty_share: float) -> int:
    """The largest number of frames that can be drawn with this share of empty frames."""
    empty = int(rows["empty"].sum())
    return min(int(empty / empty_share), int((len(rows) - empty) / (1 - empty_share)))


def draw(rows: pd.DataFrame, count: int, empty_share: float, seed: int) -> pd.DataFrame:
    """Draw rows of a pool without replacement.

    Args:
        rows: the pool.
        count: number of rows to draw.
        empty_share: share of empty frames, in [0, 1]. The others come from each group in numbers as
            equal as the groups allow.
        seed: of the draw.
    """
    rng = np.random.default_rng(seed)
    empty = rows[rows["empty"]]
    wanted = round(count * empty_share)
    parts = [empty.iloc[np.sort(rng.choice(len(empty), wanted, replace=False))]]
    # The smallest group first: larger groups make up for what it lacks.
    shown = sorted(rows[~rows["empty"]].groupby("group"), key=lambda item: (len(item[1]), item[0]))
    left = count - wanted
    for done, (_, group) in enumerate(shown):
        rest = len(shown) - done
        part = min(len(group), -(-left // rest))
        weight = group["weight"].to_numpy(float)
        # Without weights, numpy draws in another way.
        shares = None if (weight == weight[0]).all() else weight / weight.sum()
        parts.append(group.iloc[np.sort(rng.choice(len(group), part, replace=False, p=shares))])
        left -= part
    return pd.concat(parts).sort_values(["test_id", "step"], ignore_index=True)
