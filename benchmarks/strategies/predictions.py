"""Which model of a search predicts rendered tests best: trained on the beginning of one campaign, judged on the other campaigns."""

from __future__ import annotations

from collections.abc import Sequence

import contestants
import numpy as np
import pandas as pd
import recorded
import variants
from sklearn.metrics import roc_auc_score
from worlds import SPLITS, default_study

from pipeline.config.composing import functional_scenario
from pipeline.core.samplers.forest import ForestSampler
from pipeline.core.space import Floats, Space

BEGINNINGS = (100, 200, 300, 500)
FEWEST_FAILURES = 3
"""Of a beginning, for a model to learn from it."""
Campaigns = dict[str, tuple[Floats, Floats]]


MODELS = ("forest", *(name for name in variants.VARIANTS if name != "forest-transfer"))


def predictions(
    names: Sequence[str] = MODELS, scenarios: Sequence[str] = SPLITS["development"].scenarios
) -> pd.DataFrame:
    """A row for each model: the mean AUC on unseen campaigns after each number of tests, and over all of them."""
    rows: dict[str, dict[int, list[float]]] = {
        name: {count: [] for count in BEGINNINGS} for name in names
    }
    for scenario in scenarios:
        space = functional_scenario(scenario).logical_space()
        campaigns = _campaigns(scenario, space)
        for own, (points, kpi) in campaigns.items():
            others = [tests for name, tests in campaigns.items() if name != own]
            for count in BEGINNINGS:
                if np.sum(kpi[:count] <= _threshold_s()) >= FEWEST_FAILURES:
                    for name in names:
                        rows[name][count].append(
                            _auc(name, space, points[:count], kpi[:count], others)
                        )
    table = pd.DataFrame(
        {
            name: {count: np.mean(found) for count, found in row.items()}
            for name, row in rows.items()
        }
    ).T
    table["mean"] = [np.mean(np.concatenate(list(row.values()))) for row in rows.values()]
    return table.rename_axis("model").reset_index()


def _campaigns(scenario: str, space: Space) -> Campaigns:
    """Points (n, d) and KPI (n,) of the recorded campaigns; tests that ended in an error are left out."""
    found: Campaigns = {}
    for strategy, path in recorded.paths_of(scenario).items():
        table, points = recorded.campaign(path, space)
        valid = (table["status"] == "ok").to_numpy()
        found[strategy] = points[valid], table["adj_ttc_s"].to_numpy(float)[valid]
    return found


def _auc(
    name: str, space: Space, points: Floats, kpi: Floats, others: Sequence[tuple[Floats, Floats]]
) -> float:
    """The mean over the other campaigns, so that the largest does not decide."""
    model = contestants.make(name, space, 0)
    assert isinstance(model, ForestSampler)
    found = [
        roc_auc_score(failed <= _threshold_s(), variants.expected(model, points, kpi, unseen))
        for unseen, failed in others
    ]
    return float(np.mean(found))


def _threshold_s() -> float:
    return default_study().campaign.failure_threshold_s
