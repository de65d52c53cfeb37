"""Measures of search campaigns from their tables (thesis section 4.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np
import pandas as pd

from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.results import CampaignMeasures, Estimate, Modes, StrategyMeasures
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.identity import CampaignId
from pipeline.core.measures import c_measure, f_measure, failure_sequence, pair_coverage
from pipeline.core.space import Ints, Space
from pipeline.core.statistics import mean_interval, wilson_interval
from pipeline.errors import InputError

PROJECTION_K = 2


TESTS_WANTED = 3
"""Tests that projection coverage wants for every pair of categories; pair coverage wants one."""


def measure_campaign(
    campaign: CampaignId, tables: Mapping[CampaignId, pd.DataFrame], spaces: Mapping[str, Space], baseline: str
) -> CampaignMeasures:
    """Every measure of one campaign; see CampaignMeasures for their definitions."""
    tests = tables[campaign]
    reference = tables.get(replace(campaign, strategy=baseline))
    if campaign.scenario not in spaces:
        raise InputError(f"campaign {campaign}: expected the space of scenario '{campaign.scenario}', got {sorted(spaces)}")
    if reference is None:
        raise InputError(f"campaign {campaign}: expected a '{baseline}' campaign of seed {campaign.seed} beside it, got none")
    space, failed = spaces[campaign.scenario], tests["failure"].to_numpy(bool)
    sequence, other = failure_sequence(failed), failure_sequence(reference["failure"].to_numpy(bool))
    n, saved = c_measure(sequence, other)
    valid = (tests["status"] == "ok").to_numpy()
    points = encode_tests(tests, space)
    return CampaignMeasures(
        **asdict(campaign),
        tests=len(tests),
        errors=int((~valid).sum()),
        failures=int(failed.sum()),
        modes=count_modes(tests),
        theta=tuple(int(count) for count in sequence),
        f_measure=f_measure(sequence),
        n=n,
        f_n=f_measure(sequence, n),
        c_measure=None if campaign.strategy == baseline else saved,
        c_measure_assumed=campaign.strategy != baseline and int(other[-1]) == 0,
        pair_coverage_tests=pair_coverage(space, points[valid]),
        pair_coverage_failures=pair_coverage(space, points[failed]),
        projection_coverage=_projection(space, space.categorise(points[valid])),
    )


def count_modes(tests: pd.DataFrame) -> Modes:
    """Failures of a table by failure mode."""
    counts = tests.loc[tests["failure"], "failure_mode"].value_counts()
    return Modes(**{mode: int(counts.get(mode, 0)) for mode in Modes.model_fields})


def _projection(space: Space, categories: Ints) -> float:
    """Coverage in which every cell wants `TESTS_WANTED` tests, so it still distinguishes campaigns that cover all pairs."""
    weights = [np.full(size, TESTS_WANTED) for size in space.sizes]
    return projection_coverage(categories, Demand(space.constraints, PROJECTION_K, weights, "max")).ratio


def by_strategy(campaigns: Sequence[CampaignMeasures]) -> list[list[CampaignMeasures]]:
    """The summaries of campaigns that differ only by their seed."""
    groups: dict[tuple[str, str, str], list[CampaignMeasures]] = {}
    for campaign in campaigns:
        groups.setdefault((campaign.scenario, campaign.strategy, campaign.version), []).append(campaign)
    return list(groups.values())


def summarise(group: Sequence[CampaignMeasures], confidence: float) -> StrategyMeasures:
    """One strategy on one scenario over its seeds: means with Student's intervals, the failure rate with Wilson's."""
    first = group[0]
    tests, errors = sum(c.tests for c in group), sum(c.errors for c in group)
    failures = sum(c.failures for c in group)
    low, high = wilson_interval(failures, tests - errors, confidence)
    f_measures = [float(c.f_measure) for c in group if c.f_measure is not None]
    c_measures = [c.c_measure for c in group if c.c_measure is not None]

    def mean(values: Sequence[float], low: float = 0, high: float = np.inf) -> Estimate:
        interval = mean_interval(values, confidence, (low, high))
        return Estimate(value=float(np.mean(values)), low=interval[0], high=interval[1])

    return StrategyMeasures(
        scenario=first.scenario,
        strategy=first.strategy,
        version=first.version,
        seeds=tuple(c.seed for c in group),
        tests=tests,
        errors=errors,
        failures=failures,
        modes=Modes(**{mode: sum(getattr(c.modes, mode) for c in group) for mode in Modes.model_fields}),
        rate=Estimate(value=failures / max(1, tests - errors), low=low, high=high),
        failures_per_campaign=mean([float(c.failures) for c in group]),
        f_measure=mean(f_measures, 1) if f_measures else None,
        f_measure_seeds=len(f_measures),
        c_measure=mean(c_measures, -np.inf, 1) if c_measures else None,
        c_measure_seeds=len(c_measures),
        pair_coverage_tests=mean([c.pair_coverage_tests for c in group], 0, 1),
        pair_coverage_failures=mean([c.pair_coverage_failures for c in group], 0, 1),
        projection_coverage=mean([c.projection_coverage for c in group], 0, 1),
    )


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
