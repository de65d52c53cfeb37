"""Measures of search campaigns from their tables (thesis section 4.3)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace
from typing import TypeVar

import numpy as np
import pandas as pd

from pipeline.artefacts.failure_counts import Causes, FalseActivations, Modes
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.results import Estimate, Result
from pipeline.artefacts.search_results import BaseRate, CampaignMeasures, StrategyMeasures
from pipeline.artefacts.tables import is_valid
from pipeline.core.counted import Counted
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.identity import CampaignId
from pipeline.core.measures import (
    baseline_cost,
    c_measure,
    f_measure,
    failure_sequence,
    pair_coverage,
)
from pipeline.core.space import Space
from pipeline.core.statistics import censored_mean, mean_interval
from pipeline.errors import InputError

PROJECTION_K = 2
CountsT = TypeVar("CountsT", bound=Result)

TESTS_WANTED = 3
"""Tests that projection coverage wants for every pair of categories; pair coverage wants one."""


def measure_campaign(
    campaign: CampaignId,
    tables: Mapping[CampaignId, pd.DataFrame],
    spaces: Mapping[str, Space],
    baseline: str,
) -> CampaignMeasures:
    """Every measure of one campaign; see CampaignMeasures for their definitions.

    Args:
        campaign: The campaign.
        tables: Rows of tests.parquet of all campaigns.
        spaces: Scenario -> its space.
        baseline: Strategy that the others are compared with.

    Raises:
        InputError: The space or the baseline's campaign of the same seed is missing.
    """
    tests = tables[campaign]
    reference = tables.get(replace(campaign, strategy=baseline))
    if campaign.scenario not in spaces:
        raise InputError(
            f"campaign {campaign}: expected the space of scenario '{campaign.scenario}', got "
            f"{sorted(spaces)}"
        )
    if reference is None:
        raise InputError(
            f"campaign {campaign}: expected a '{baseline}' campaign of seed {campaign.seed} beside "
            "it, got none"
        )
    space, failed = spaces[campaign.scenario], tests["failure"].to_numpy(bool)
    sequence = failure_sequence(failed)
    other = failure_sequence(reference["failure"].to_numpy(bool))
    n, saved = c_measure(sequence, other)
    valid = is_valid(tests).to_numpy()
    points = encode_tests(tests, space)
    # Every cell wants several tests, so it still distinguishes campaigns that cover all pairs.
    weights = [np.full(size, TESTS_WANTED) for size in space.sizes]
    demand = Demand(space.constraints, PROJECTION_K, weights, "max")
    return CampaignMeasures(
        **asdict(campaign),
        tests=len(tests),
        errors=int((~valid).sum()),
        failures=int(failed.sum()),
        modes=count_modes(tests),
        causes=count_causes(tests),
        false_activations=count_false_activations(tests),
        theta=tuple(int(count) for count in sequence),
        f_measure=f_measure(sequence),
        n=n,
        f_n=f_measure(sequence, n),
        f_n_baseline=baseline_cost(other)[1],
        c_measure=None if campaign.strategy == baseline else saved,
        c_measure_assumed=campaign.strategy != baseline and int(other[-1]) == 0,
        pair_coverage_tests=pair_coverage(space, points[valid]),
        pair_coverage_failures=pair_coverage(space, points[failed]),
        projection_coverage=projection_coverage(space.categorise(points[valid]), demand).ratio,
    )


def count_modes(tests: pd.DataFrame) -> Modes:
    """Failures of a table by failure mode."""
    return Modes(**_counts(tests, "failure_mode", Modes))


def count_causes(tests: pd.DataFrame) -> Causes:
    """Failures of a table by cause."""
    return Causes(**_counts(tests, "cause", Causes))


def _counts(tests: pd.DataFrame, column: str, model: type[Result]) -> dict[str, int]:
    counts = tests.loc[tests["failure"], column].value_counts()
    return {name: int(counts.get(name, 0)) for name in model.model_fields}


def count_false_activations(tests: pd.DataFrame) -> FalseActivations:
    """Unnecessary emergency braking in the valid tests of a table."""
    valid = tests[is_valid(tests)]
    braking = valid[valid["false_activations"] > 0]
    return FalseActivations(
        tests=len(valid),
        braking=len(braking),
        number=int(braking["false_activations"].sum()),
        duration_s=float(braking["false_activation_s"].sum()),
        speed_loss_mps=float(braking["speed_loss_mps"].sum()),
    )


def _total(parts: Sequence[CountsT]) -> CountsT:
    """The sum of counts, field by field."""
    kind, sums = type(parts[0]), {}
    for name in kind.model_fields:
        sums[name] = sum(getattr(part, name) for part in parts)
    return kind(**sums)


def by_strategy(campaigns: Sequence[CampaignMeasures]) -> list[list[CampaignMeasures]]:
    """The measures of campaigns that differ only by their seed, group by group."""
    groups: dict[tuple[str, str, str], list[CampaignMeasures]] = {}
    for campaign in campaigns:
        key = (campaign.scenario, campaign.strategy, campaign.version)
        groups.setdefault(key, []).append(campaign)
    return list(groups.values())


def summarise(
    group: Sequence[CampaignMeasures],
    confidence: float,
    baseline: str,
    independent: Collection[str],
) -> StrategyMeasures:
    """One strategy on one scenario over its seeds; see StrategyMeasures for the intervals.

    Args:
        group: Campaigns that differ only by their seed.
        confidence: Confidence of the intervals, in (0, 1).
        baseline: Strategy that the others are compared with.
        independent: Strategies whose tests are independent samples of the space.
    """
    first = group[0]

    def mean(values: Sequence[float], low: float = 0, high: float = np.inf) -> Estimate:
        interval = mean_interval(values, confidence, (low, high))
        return Estimate(value=float(np.mean(values)), low=interval[0], high=interval[1])

    reached = [c.f_measure is not None for c in group]
    spent = [c.f_measure or c.tests for c in group]
    to_first = censored_mean(spent, reached, confidence, least=1)
    saved, censored = None, 0
    if first.strategy != baseline:
        # Tests until the n-th failure as a share of the baseline's, 1 - C_n; at least the share of
        # the whole budget if it was not reached.
        shares = [(c.f_n or c.tests) / c.f_n_baseline for c in group]
        cost = censored_mean(shares, [c.f_n is not None for c in group], confidence)
        saved = Estimate(value=1 - cost.value, low=1 - cost.high, high=1 - cost.low)
        censored = cost.censored
    if first.strategy in independent:
        tests, failures = (sum(c.tests - c.errors for c in group), sum(c.failures for c in group))
        rate = _exact(Counted(tests, failures), confidence)
    else:
        rate = mean([c.failures / max(1, c.tests - c.errors) for c in group], 0, 1)
    return StrategyMeasures(
        scenario=first.scenario,
        strategy=first.strategy,
        version=first.version,
        seeds=tuple(c.seed for c in group),
        tests=sum(c.tests for c in group),
        errors=sum(c.errors for c in group),
        failures=sum(c.failures for c in group),
        modes=_total([c.modes for c in group]),
        causes=_total([c.causes for c in group]),
        false_activations=_total([c.false_activations for c in group]),
        rate=rate,
        f_measure=Estimate(value=to_first.value, low=to_first.low, high=to_first.high),
        f_measure_censored=to_first.censored,
        c_measure=saved,
        c_measure_censored=censored,
        pair_coverage_tests=mean([c.pair_coverage_tests for c in group], 0, 1),
        pair_coverage_failures=mean([c.pair_coverage_failures for c in group], 0, 1),
        projection_coverage=mean([c.projection_coverage for c in group], 0, 1),
    )


def _exact(counted: Counted, confidence: float) -> Estimate:
    """A failure rate with its exact interval; 0 in [0, 1] without tests."""
    return Estimate.of(counted, confidence) or Estimate(value=0, low=0, high=1)


def audited(tables: Mapping[CampaignId, pd.DataFrame], confidence: float) -> tuple[BaseRate, ...]:
    """The failure rates of campaigns with independent tests, over all seeds.

    One rate a scenario, strategy and version.
    """
    groups: dict[tuple[str, str, str], list[pd.DataFrame]] = {}
    for campaign, tests in tables.items():
        key = (campaign.scenario, campaign.strategy, campaign.version)
        groups.setdefault(key, []).append(tests)
    rates = []
    for (scenario, strategy, version), each in groups.items():
        tests = pd.concat(each)
        counted = Counted.of(tests["failure"].to_numpy(bool), (~is_valid(tests)).to_numpy())
        rates.append(
            BaseRate(
                scenario=scenario,
                strategy=strategy,
                version=version,
                tests=counted.tests,
                failures=counted.failures,
                rate=_exact(counted, confidence),
            )
        )
    return tuple(rates)


def series_name(measured: CampaignMeasures | StrategyMeasures) -> str:
    """Name in plots and metrics: scenario, strategy and, except for the base, version."""
    name = f"{measured.scenario}-{measured.strategy}"
    return name if measured.version == "base" else f"{name}-{measured.version}"


def theta_table(campaigns: Sequence[CampaignMeasures]) -> pd.DataFrame:
    """Failures found after 1, 2, ... tests.

    Returns:
        Column `tests`, then the mean over seeds by `series_name`.
    """
    columns = {}
    for group in by_strategy(campaigns):
        length = min(len(campaign.theta) for campaign in group)
        curves = np.array([campaign.theta[:length] for campaign in group])
        columns[series_name(group[0])] = pd.Series(curves.mean(axis=0))
    table = pd.DataFrame(columns)
    table.insert(0, "tests", np.arange(1, len(table) + 1))
    return table
