"""Selects kept frames for training: of all tests or of failures, balanced over regions or causes, or by how the detector did in them."""

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
"""Columns of a pool of frames: empty: no visible pedestrian; group: rows are drawn in equal numbers from each; scenario: '' for none;
weight: how often a row is drawn, relative to others of its group."""
ANY = ""
"""The only group if nothing is balanced."""
LEAST = 0.05
"""Weight of frames that teach least, so that a pool never runs dry."""
WEIGHTS: Mapping[str, Callable[[Floats], Floats]] = {
    "unsure": lambda confidence: LEAST + 4 * confidence * (1 - confidence),
    "missed": lambda confidence: LEAST - np.log(np.maximum(confidence, LEAST)),
}
"""Selection -> weight of frames by the confidence, (n,), with which the searched version detected the pedestrian in them. `unsure`: the
variance of a coin with that bias; `missed`: the log loss."""


def groups(
    selection: str,
    tests: pd.DataFrame,
    spaces: Mapping[str, tuple[ScenarioInfo, Space]],
    section: Regions,
) -> dict[str, str]:
    """test_id -> group, for the tests with frames that may be added.

    selection: `all` tests, `failures`, all tests by `causes`, each cause a group and passing tests another, or failures by `regions`, each
    region a group, plus one group per scenario for failures in no region; those of `WEIGHTS` take all tests. tests: rows of all campaigns
    of one source.
    """
    if selection == "all" or selection in WEIGHTS:
        return dict.fromkeys(tests["test_id"], ANY)
    if selection == "causes":
        return dict(zip(tests["test_id"], tests["cause"], strict=True))
    failed = tests[tests["failure"]]
    if selection == "failures":
        return dict.fromkeys(failed["test_id"], ANY)
    found: dict[str, str] = {}
    for scenario, rows in tests[is_valid(tests)].groupby("scenario"):
        info, space = spaces[str(scenario)]
        regions = cluster(info, space, rows.reset_index(drop=True), section)
        found |= dict.fromkeys(regions.isolated, f"{info.label}, isolated")
        found |= {test: region.name for region in regions.regions for test in region.members}
    return found


def pool(
    judged: pd.DataFrame,
    grouped: Mapping[str, str],
    scenarios: Mapping[str, str],
    selection: str = "all",
) -> pd.DataFrame:
    """The frames that may be drawn, in a fixed order, with the columns `POOL`.

    judged: rows of filter tables. grouped, scenarios: group and scenario by test. selection: as for `groups`.
    """
    rows = judged[judged["kept"] & judged["test_id"].isin(list(grouped))]
    ids = rows["test_id"]
    rows = rows.assign(
        empty=rows["visible_pixels"] == 0, group=ids.map(grouped), scenario=ids.map(scenarios)
    )
    rows = rows.assign(
        weight=WEIGHTS[selection](rows["confidence"].to_numpy(float))
        if selection in WEIGHTS
        else 1.0
    )
    return rows[POOL].sort_values(["test_id", "step"], ignore_index=True)


def capacity(rows: pd.DataFrame, empty_share: float) -> int:
    """The largest number of frames that can be drawn with this share of empty frames."""
    empty = int(rows["empty"].sum())
    return min(int(empty / empty_share), int((len(rows) - empty) / (1 - empty_share)))


def draw(rows: pd.DataFrame, count: int, empty_share: float, seed: int) -> pd.DataFrame:
    """Draw `count` rows of a pool without replacement: a share of them empty, the others from each group in numbers as equal as the groups
    allow."""
    rng = np.random.default_rng(seed)
    empty = rows[rows["empty"]]
    wanted = round(count * empty_share)
    parts = [empty.iloc[np.sort(rng.choice(len(empty), wanted, replace=False))]]
    shown = {name: group for name, group in rows[~rows["empty"]].groupby("group")}
    left = count - wanted
    for rest, (_, group) in zip(
        range(len(shown), 0, -1),
        sorted(shown.items(), key=lambda item: (len(item[1]), item[0])),
        strict=True,
    ):
        # The smallest first: larger groups make up for what it lacks.
        part = min(len(group), -(-left // rest))
        weight = group["weight"].to_numpy(float)
        # Without weights, numpy draws in another way.
        shares = None if (weight == weight[0]).all() else weight / weight.sum()
        parts.append(group.iloc[np.sort(rng.choice(len(group), part, replace=False, p=shares))])
        left -= part
    return pd.concat(parts).sort_values(["test_id", "step"], ignore_index=True)
