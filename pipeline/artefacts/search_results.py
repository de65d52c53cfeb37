"""measures.json: the measures of the search campaigns, each alone and by scenario and strategy."""

from __future__ import annotations

from pipeline.artefacts.failure_counts import Causes, FalseActivations, Modes
from pipeline.artefacts.results import Estimate, Result


class BaseRate(Result):
    """How often a version fails in the independent tests of a search scenario, over all seeds.

    These are the tests of a random strategy, or else of the audit.

    Attributes:
        rate: failures of `tests` without an error, with its exact interval (Clopper-Pearson).
    """

    scenario: str
    version: str
    strategy: str
    tests: int
    failures: int
    rate: Estimate


class CampaignMeasures(Result):
    """Measures of one campaign; an error counts as executed, never as a failure.

    Attributes:
        theta: cumulative failures after each test (Eq. 4.17).
        f_measure, f_n: tests until the first and until the n-th failure (Eq. 4.18, 4.19), where n
            is the number of failures that random testing found in the budget (1 if it found none),
            and f_n_baseline the number of tests that it needed; f_measure and f_n are null if the
            campaign found fewer failures.
        c_measure: Eq. 4.20, against the baseline campaign of the same scenario and seed;
            `c_measure_assumed` if Eq. 6.2's assumption replaces the baseline's first failure; null
            for the baseline, and if the strategy did not find n failures. Coverages in [0, 1].
    """

    scenario: str
    strategy: str
    version: str
    seed: int
    tests: int
    errors: int
    failures: int
    modes: Modes
    causes: Causes
    false_activations: FalseActivations
    theta: tuple[int, ...]
    f_measure: int | None
    n: int
    f_n: int | None
    f_n_baseline: int
    c_measure: float | None
    c_measure_assumed: bool
    pair_coverage_tests: float
    pair_coverage_failures: float
    projection_coverage: float


class StrategyMeasures(Result):
    """Means over the seeds of one scenario and strategy, with Student's intervals.

    Attributes:
        rate: failures per valid test. If the strategy draws independent samples, all tests are
            pooled and the interval is exact; the tests of other strategies depend on each other, so
            theirs is Student's over the campaigns' rates.
        f_measure, c_measure: Kaplan-Meier estimates of the restricted mean, because a campaign
            without its first, or n-th, failure is right-censored at its last test;
            `f_measure_censored` and `c_measure_censored` campaigns are. See
            `pipeline.core.statistics.censored_mean`. c_measure is null for the baseline.
    """

    scenario: str
    strategy: str
    version: str
    seeds: tuple[int, ...]
    tests: int
    errors: int
    failures: int
    modes: Modes
    causes: Causes
    false_activations: FalseActivations
    rate: Estimate
    f_measure: Estimate
    f_measure_censored: int
    c_measure: Estimate | None
    c_measure_censored: int
    pair_coverage_tests: Estimate
    pair_coverage_failures: Estimate
    projection_coverage: Estimate


class Measures(Result):
    """All search campaigns measured.

    Attributes:
        confidence: of every interval.
        audit: failure rates without bias, which no adaptive test enters.
        no_braking: scenarios in which the right answer is not to brake.
    """

    confidence: float
    baseline: str
    campaigns: tuple[CampaignMeasures, ...]
    strategies: tuple[StrategyMeasures, ...]
    audit: tuple[BaseRate, ...] = ()
    no_braking: tuple[str, ...] = ()

    @property
    def base_rates(self) -> tuple[BaseRate, ...]:
        """The base failure rate of each scenario: the audit of the first version."""
        version = self.strategies[0].version if self.strategies else ""
        return tuple(rate for rate in self.audit if rate.version == version)

    def of(self, version: str) -> Measures:
        """The measures of the campaigns against one version."""
        campaigns = tuple(measured for measured in self.campaigns if measured.version == version)
        strategies = tuple(measured for measured in self.strategies if measured.version == version)
        audit = tuple(rate for rate in self.audit if rate.version == version)
        return self.model_copy(
            update={"campaigns": campaigns, "strategies": strategies, "audit": audit}
        )
