"""Meta-model testing with linear regression.

Source: thesis section 4.4.3, Eq. 4.28 to 4.32, and Table 6.1, row 4.
"""

from __future__ import annotations

import numpy as np

from pipeline.core.samplers.meta_model import Hyperparameters, MetaModel, MetaModelSampler
from pipeline.core.space import Floats


class LinearSampler(MetaModelSampler):
    """Predicts the KPI as a weighted sum of the inputs, with an intercept; no hyperparameters.

    The search and its parameters are those of `MetaModelSampler`. Eq. 4.32 has no inverse, because
    the inputs of a category add up to 1; the solution of Eq. 4.31 with the least norm is used
    instead.
    """

    def fit(
        self, inputs: Floats, kpi: Floats, hyperparameters: Hyperparameters, seed: int
    ) -> MetaModel:
        intercept = kpi.mean()
        centre = inputs.mean(axis=0)
        slopes, *_ = np.linalg.lstsq(inputs - centre, kpi - intercept)
        return lambda others: ((others - centre) @ slopes + intercept, np.zeros(len(others)))
