"""Meta-model testing with a Gaussian process.

Source: thesis section 4.4.3, Appendix B, and Table 6.1, row 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pipeline.core.samplers.meta_model import Hyperparameters, MetaModel, MetaModelSampler
from pipeline.core.space import Floats


@dataclass(eq=False, repr=False, kw_only=True)
class GaussianProcessSampler(MetaModelSampler):
    """Predicts the KPI by the posterior mean of a Gaussian process with an RBF kernel.

    Source: thesis Appendix B, Eq. (7) and (.11) to (.15). The KPI is standardised, so that its
    prior has mean 0 and variance 1. Hyperparameters: `length`, the kernel's sigma, and `noise`, the
    variance of an observation.

    The prediction of Algorithm 2 is the mean (section 4.4.3). The thesis does not use the deviation
    in the search; `kappa` does. The search and its other parameters are those of
    `MetaModelSampler`.

    Args:
        kappa: standard deviations to subtract from the mean, in [0, 100]; above 0, uncertain
            candidates are tested sooner.
    """

    grid: ClassVar[tuple[Hyperparameters, ...]] = tuple(
        {"length": length, "noise": noise} for length in (1.5, 3.0, 6.0) for noise in (0.01, 0.1)
    )

    kappa: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.limit("[0, 100]", "kappa")

    def rank(self, kpi: Floats, deviation: Floats) -> Floats:
        """The mean minus `kappa` standard deviations, (n,)."""
        return kpi - self.kappa * deviation

    def fit(
        self, inputs: Floats, kpi: Floats, hyperparameters: Hyperparameters, seed: int
    ) -> MetaModel:
        # Takes seconds to import, and every study constructs every strategy to check it.
        from sklearn.gaussian_process import GaussianProcessRegressor
        from sklearn.gaussian_process.kernels import RBF

        kernel, noise = RBF(hyperparameters["length"]), hyperparameters["noise"]
        process = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None, normalize_y=True)
        process.fit(inputs, kpi)
        return lambda others: process.predict(others, return_std=True)
