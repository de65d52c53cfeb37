"""How true the emulators are, on executed tests that they have not seen (five-fold cross-validation)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pandas as pd
from emulators import FAMILIES, expected_kpi, fit
from numpy.typing import NDArray
from recorded import Recorded
from scipy.stats import spearmanr
from sklearn.metrics import brier_score_loss, roc_auc_score
from sklearn.model_selection import StratifiedKFold

from pipeline.core.reliability import platt
from pipeline.core.space import Floats

FOLDS = 5


def truth(recordings: Iterable[tuple[str, Recorded]]) -> pd.DataFrame:
    """A row for each scenario, family and half, of random and of adaptive tests.

    spearman: of the expected KPI. auc: of failure. brier_skill: 1 minus the Brier score over that of the constant base rate. slope: of
    the observed log-odds of failure over the predicted ones; 1 is right, below 1 too sure. predicted_%, observed_%: mean failure rates.
    """
    return pd.DataFrame(
        [row for scenario, recorded in recordings for row in _rows(scenario, recorded)]
    )


def _rows(scenario: str, recorded: Recorded) -> Iterator[dict[str, Any]]:
    for family in FAMILIES:
        probability, kpi = _unseen(family, recorded)
        for half, chosen in (("random", recorded.random), ("adaptive", ~recorded.random)):
            failed = recorded.failed[chosen]
            if failed.any() and not failed.all():
                judged = _judged(probability[chosen], kpi[chosen], failed, recorded.kpi[chosen])
                yield {
                    "scenario": scenario,
                    "family": family,
                    "half": half,
                    "tests": len(failed),
                    **judged,
                }


def _judged(
    probability: Floats, expected: Floats, failed: NDArray[np.bool_], kpi: Floats
) -> dict[str, float]:
    base = float(failed.mean())
    return {
        "spearman": float(spearmanr(expected, kpi).statistic),
        "auc": float(roc_auc_score(failed, probability)),
        "brier": float(brier_score_loss(failed, probability)),
        "brier_skill": 1 - float(brier_score_loss(failed, probability)) / (base * (1 - base)),
        "slope": platt(probability, failed).slope,
        "predicted_%": 100 * float(probability.mean()),
        "observed_%": 100 * base,
    }


def _unseen(family: str, recorded: Recorded) -> tuple[Floats, Floats]:
    """Probability of failure and expected KPI of each test, by a model of the other folds."""
    probability, kpi = np.zeros(len(recorded.kpi)), np.zeros(len(recorded.kpi))
    folds = StratifiedKFold(FOLDS, shuffle=True, random_state=0)
    for seen, unseen in folds.split(recorded.points, recorded.failed):
        model = fit(family, recorded.rows(seen))
        probability[unseen], kpi[unseen] = expected_kpi(
            model, recorded.space, recorded.points[unseen]
        )
    return probability, kpi
