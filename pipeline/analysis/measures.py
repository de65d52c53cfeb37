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
from pipeline.core.space import Ints, Space
from pipeline.core.statistics import CensoredMean, censored_mean, mean_interval
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
    """Every measure of one campaign; see CampaignMeasures for their definitions."""
    tests = tables[campaign]
    reference = tables.get(replace(campaign, strategy=baseline))
    if campaign.scenario not in spaces:
        raise InputError(
            f"campaign {campaign}: expected the space of scenario '{campaign.scenario}', got {sorted(spaces)}"
        )
    if reference is None:
        raise InputError(
            f"campaign {campaign}: expected a '{baseline}' campaign of seed {campaign.seed} beside it, got none"
        )
    space, failed = spaces[campaign.scenario], tests["failure"].to_numpy(bool)
    sequence, other = (
        failure_sequence(failed),
        failure_sequence(reference["failure"].to_numpy(bool)),
    )
    n, saved = c_measure(sequence, other)
    valid = is_valid(tests).to_numpy()
    points = encode_tests(tests, space)
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
        projection_coverage=_projection(space, space.categorise(points[valid])),
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
    first = type(parts[0])
    return first(
        **{name: sum(getattr(part, name) for part in parts) for name in first.model_fields}
    )


def _projection(space: Space, categories: Ints) -> float:
    """Coverage in which every cell wants `TESTS_WANTED` tests, so it still distinguishes campaigns that cover all pairs."""
    weights = [np.full(size, TESTS_WANTED) for size in space.sizes]
    return projection_coverage(
        categories, Demand(space.constraints, PROJECTION_K, weights, "max")
    ).ratio


def by_strategy(campaigns: Sequence[CampaignMeasures]) -> list[list[CampaignMeasures]]:
    """The summaries of campaigns that differ only by their seed."""
    groups: dict[tuple[str, str, str], list[CampaignMeasures]] = {}
    for campaign in campaigns:
        groups.setdefault((campaign.scenario, campaign.strategy, campaign.version), []).append(
            campaign
        )
    return list(groups.values())


def summarise(
    group: Sequence[CampaignMeasures],
    confidence: float,
    baseline: str,
    independent: Collection[str],
) -> StrategyMeasures:
    """One strategy on one scenario over its seeds; see StrategyMeasures for the intervals.

    independent: strategies whose tests are independent samples of the space.
    """
    first = group[0]

    def mean(values: Sequence[float], low: float = 0, high: float = np.inf) -> Estimate:
        interval = mean_interval(values, confidence, (low, high))
        return Estimate(value=float(np.mean(values)), low=interval[0], high=interval[1])

    found = censored_mean(
        [c.f_measure or c.tests for c in group],
        [c.f_measure is not None for c in group],
        confidence,
        least=1,
    )
    cost = None if first.strategy == baseline else _cost(group, confidence)
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
        rate=_pooled_rate(group, confidence)
        if first.strategy in independent
        else mean(list(map(_rate, group)), 0, 1),
        f_measure=Estimate(value=found.value, low=found.low, high=found.high),
        f_measure_censored=found.censored,
        c_measure=None
        if cost is None
        else Estimate(value=1 - cost.value, low=1 - cost.high, high=1 - cost.low),
        c_measure_censored=0 if cost is None else cost.censored,
        pair_coverage_tests=mean([c.pair_coverage_tests for c in group], 0, 1),
        pair_coverage_failures=mean([c.pair_coverage_failures for c in group], 0, 1),
        projection_coverage=mean([c.projection_coverage for c in group], 0, 1),
    )


def _cost(group: Sequence[CampaignMeasures], confidence: float) -> CensoredMean:
    """Tests until the n-th failure as a share of the baseline's, 1 - C_n; at least that of the whole budget if it was not reached."""
    spent = [(c.f_n or c.tests) / c.f_n_baseline for c in group]
    return censored_mean(spent, [c.f_n is not None for c in group], confidence)


def _rate(campaign: CampaignMeasures) -> float:
    return campaign.failures / max(1, campaign.tests - campaign.errors)


def _pooled_rate(group: Sequence[CampaignMeasures], confidence: float) -> Estimate:
    """Failures per valid test over all campaigns, for independent tests only."""
    return _exact(
        Counted(sum(c.tests - c.errors for c in group), sum(c.failures for c in group)), confidence
    )


def _exact(counted: Counted, confidence: float) -> Estimate:
    """A failure rate with its exact interval; 0 in [0, 1] without tests."""
    return Estimate.of(counted, confidence) or Estimate(value=0, low=0, high=1)


def audited(tables: Mapping[CampaignId, pd.DataFrame], confidence: float) -> tuple[BaseRate, ...]:
    """The failure rates of campaigns with independent tests, by scenario, strategy and version, over all seeds."""
    groups: dict[tuple[str, str, str], list[pd.DataFrame]] = {}
    for campaign, tests in tables.items():
        groups.setdefault((campaign.scenario, campaign.strategy, campaign.version), []).append(
            tests
        )
    rates = []
    for (scenario, strategy, version), each in groups.items():
        tests = pd.concat(each)
        counted = Counted.of(tests["failure"].to_numpy(bool), (~is_valid(tests)).to_numpy())
        named = {"scenario": scenario, "strategy": strategy, "version": version}
        rates.append(
            BaseRate(
                **named,
                tests=counted.tests,
                failures=counted.failures,
                rate=_exact(counted, confidence),
            )
        )
    return tuple(rates)


def series_name(measured: CampaignMeasures | StrategyMeasures) -> str:
    """The name of a scenario and strategy in plots and metrics; it includes the version unless that is the base."""
    own = f"{measured.scenario}-{measured.strategy}"
    return own if measured.version == "base" else f"{own}-{measured.version}"


def theta_table(campaigns: Sequence[CampaignMeasures]) -> pd.DataFrame:
    """Failures found after 1, 2, ... tests: column `tests`, then the mean over seeds by `series_name`."""
    columns = {}
    for group in by_strategy(campaigns):
        length = min(len(campaign.theta) for campaign in group)
        curves = np.array([campaign.theta[:length] for campaign in group])
        columns[series_name(group[0])] = pd.Series(curves.mean(axis=0))
    table = pd.DataFrame(columns)
    table.insert(0, "tests", np.arange(1, len(table) + 1))
    return table
