"""The areas of the thesis' Figure 8.1 (ISO 21448), estimated from a study's tests.

Known areas come from all tests. Rates come from random tests alone, judged by rules that were
fitted without them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import pandas as pd

from pipeline.analysis.failure_regions import outcomes_of
from pipeline.analysis.measures import PROJECTION_K
from pipeline.analysis.stored_rules import stored_rule
from pipeline.artefacts.evidence import (
    Area,
    Areas,
    Coverage,
    Domain,
    OpenRegion,
    Risk,
    ScenarioEvidence,
    Whole,
)
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.region_results import FailureRegion, FailureRegions
from pipeline.artefacts.results import Estimate
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.artefacts.tables import is_valid
from pipeline.config.exposure import ExposureFile
from pipeline.config.sections import Regions
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.exposure import Exposure
from pipeline.core.grouping import group_failures
from pipeline.core.likelihood.rate import TAIL, Limits, Rate, combined, exact
from pipeline.core.likelihood.reweighted import reweighted
from pipeline.core.rules import Bools
from pipeline.core.shown import shown_share
from pipeline.core.space import Floats, Space
from pipeline.errors import InputError

DRAWS = 100_000
"""Conditions drawn from the exposure to measure a share; no test is executed for them."""
NORMAL, ONE_SIDED = (NormalDist().inv_cdf(1 - tail) for tail in (TAIL, 2 * TAIL))
"""In standard errors: half the width of an interval, and the distance of a one-sided limit."""
NO_RANDOM = "no random test was executed, and the tests of other strategies give no rate"
UNCONFIRMED = "no rule was tested by fresh random tests; regions.confirm says how many to execute"
ONLY_RANDOM = (
    "every test is random: rules that are fitted to these tests cannot be judged by them; add a "
    "search to the strategies"
)
SAMPLED = f"{DRAWS:,} conditions drawn from the exposure; "
COMBINATIONS = f"{PROJECTION_K}-combinations of categories"
OUTSIDE = f"Conditions outside all rules, times the share of their {COMBINATIONS}"
KNOWN_UNSAFE = Area(
    share=None,
    definition="Conditions inside the rule of a failure region, confirmed or not.",
    source=SAMPLED + "rules from the tests of all strategies.",
)
CONFIRMED = Area(
    share=None,
    definition="The part of the known unsafe area inside a rule that fresh random tests confirmed.",
    source=SAMPLED + "rules with the status confirmed.",
)
KNOWN_SAFE = Area(
    share=None,
    definition=f"{OUTSIDE} that a passed test covers.",
    source=SAMPLED + "passed tests of all strategies.",
)
UNKNOWN = Area(
    share=None,
    definition=f"{OUTSIDE} that no passed test covers.",
    source=SAMPLED + "passed tests of all strategies.",
)
UNKNOWN_UNSAFE = Risk(
    share=None,
    definition="Failures outside the rules of all failure regions that the searches found.",
    source="Random tests, judged by rules that are fitted to the tests of all other strategies.",
)
FAILURE = Risk(share=None, definition="Failures, inside rules or not.", source="Random tests.")


@dataclass(frozen=True)
class Searched:
    """The tests and regions of one scenario.

    Attributes:
        info: The scenario.
        space: Its space.
        tests: Rows of all campaigns against the detector, its audit included.
        regions: Its failure regions.
        independent: Strategies whose tests are random.
    """

    info: ScenarioInfo
    space: Space
    tests: pd.DataFrame
    regions: FailureRegions
    independent: frozenset[str]

    @property
    def valid(self) -> pd.DataFrame:
        """The tests that did not end in an error."""
        return self.tests[is_valid(self.tests)]

    def rows(self, random: bool) -> pd.DataFrame:
        """The valid tests that are random, or the others without repeated points."""
        rows = self.valid[self.valid["strategy"].isin(self.independent) == random]
        if not random:
            rows = rows.drop_duplicates(list(self.space.names))
        return rows.reset_index(drop=True)


@dataclass(frozen=True)
class Judged:
    """The shares of one scenario as rates, which can be combined with those of other scenarios.

    Attributes:
        tested: The tests of the scenario.
        sampled: Area -> its share, for the areas that need no random test.
        regions: Region -> its share.
        failure: The failure rate, if there is an estimate.
        hidden: The rate of failures outside all rules, if there is an estimate.
        missing: Why there is no estimate of `hidden`.
    """

    tested: Searched
    sampled: Mapping[str, Rate]
    regions: Mapping[str, Rate]
    failure: Rate | None
    hidden: Rate | None
    missing: str


def judged(tested: Searched, section: Regions, exposure: ExposureFile) -> Judged:
    """The shares of one scenario.

    Args:
        tested: The tests of the scenario.
        section: Settings of the search for regions.
        exposure: The exposure that the rates refer to.
    """
    road = exposure.of(tested.info.name, tested.space)
    points = road.sample(DRAWS, np.random.default_rng(0))
    inside = {}
    for region in tested.regions.regions:
        rule = stored_rule(tested.space, region.conditions)
        inside[region.name] = rule.holds(points)
    failure, hidden, missing = _risks(tested, section, None if exposure.uniform else road)
    shares = {name: share_of(holds) for name, holds in inside.items()}
    return Judged(tested, _sampled(tested, points, inside), shares, failure, hidden, missing)


def _sampled(tested: Searched, points: Floats, inside: Mapping[str, Bools]) -> dict[str, Rate]:
    """The areas that need no random test.

    points: (n, d), drawn from the exposure. inside: region -> whether its rule holds, (n,).
    """
    regions = tested.regions.regions
    confirmed = [inside[region.name] for region in regions if region.status == "confirmed"]
    asked = not regions or any(region.confirmation for region in regions)
    in_rules = _any([*inside.values()], len(points))
    passed = tested.valid[~tested.valid["failure"].to_numpy(bool)]
    seen = tested.space.categorise(encode_tests(passed, tested.space))
    shown = shown_share(tested.space.sizes, seen, tested.space.categorise(points), PROJECTION_K)
    areas = {"known_unsafe": share_of(in_rules)}
    if asked:
        areas["confirmed"] = share_of(_any(confirmed, len(points)))
    areas["known_safe"] = mean_of(shown * ~in_rules)
    areas["unknown"] = mean_of((1 - shown) * ~in_rules)
    return areas


def _any(holds: Sequence[Bools], count: int) -> Bools:
    """Whether any of the rules holds, (count,)."""
    return np.any(holds, axis=0) if holds else np.zeros(count, bool)


def _risks(
    tested: Searched, section: Regions, road: Exposure | None
) -> tuple[Rate | None, Rate | None, str]:
    """The failure rate, the rate outside all rules, and why the second is missing.

    road: the exposure; None if random tests follow it.
    """
    random, others = tested.rows(random=True), tested.rows(random=False)
    if random.empty:
        return None, None, NO_RANDOM
    points, failed = encode_tests(random, tested.space), random["failure"].to_numpy(bool)
    errors = int(
        (tested.tests["strategy"].isin(tested.independent) & ~is_valid(tested.tests)).sum()
    )

    def rate(counted: Bools) -> Rate:
        if road is not None:
            return reweighted(road, points, counted, errors)
        count, tests = int(counted.sum()), len(counted)
        return Rate(count / tests, exact(count, tests), tests, count, errors)

    if others.empty:
        return rate(failed), None, ONLY_RANDOM
    outcomes, causes = outcomes_of(tested.space, others), others["cause"].to_numpy(str)
    groups = group_failures(outcomes, causes, section.chance_neighbours, section.min_failures)
    inside = [group.rule.holds(points) for group in groups]
    return rate(failed), rate(failed & ~_any(inside, len(points))), ""


def share_of(holds: Bools) -> Rate:
    """The share of drawn conditions that hold, with its exact interval."""
    count = int(holds.sum())
    return Rate(count / len(holds), exact(count, len(holds)), len(holds), count)


def mean_of(shares: Floats) -> Rate:
    """The mean of a share over drawn conditions, with its normal interval.

    The interval is exact if all shares are 0 or all are 1.
    """
    value, error = float(shares.mean()), float(shares.std()) / np.sqrt(len(shares))
    if not error and value in (0.0, 1.0):
        return share_of(shares == 1)
    low, high, below = value - NORMAL * error, value + NORMAL * error, value + ONE_SIDED * error
    return Rate(value, Limits(max(0.0, low), min(1.0, high), min(1.0, below)), len(shares), 0)


def scenario_evidence(judged: Judged) -> ScenarioEvidence:
    """The evidence of one scenario."""
    tested = judged.tested
    info, clauses = tested.info, []
    for clause in tested.space.clauses:
        clauses.append((clause,) if isinstance(clause, str) else clause)
    categories = tested.space.categorise(encode_tests(tested.valid, tested.space))
    reached = projection_coverage(categories, Demand(tested.space.constraints, PROJECTION_K))
    return ScenarioEvidence(
        domain=Domain(
            scenario=info.name,
            label=info.label,
            description=info.description,
            variables=tested.space.to_dict(),
            constraints=tuple(clauses),
        ),
        coverage=Coverage(
            k=PROJECTION_K,
            covered=reached.covered,
            required=reached.required,
            ratio=reached.ratio,
            tests=len(categories),
        ),
        failure=_risk(FAILURE, judged.failure, NO_RANDOM),
        areas=_areas(judged.sampled, judged.hidden, judged.missing),
        open_regions=tuple(
            _open_region(region, judged.regions[region.name]) for region in tested.regions.regions
        ),
        isolated_failures=len(tested.regions.isolated),
    )


def whole(scenarios: Sequence[Judged], exposure: ExposureFile) -> Whole | None:
    """All scenarios together; None if the exposure does not say how often each occurs."""
    names = [judged.tested.info.name for judged in scenarios]
    try:
        shares = exposure.shares(names)
    except InputError:
        return None

    def together(rates: Sequence[Rate | None]) -> Rate | None:
        """The rate over all scenarios, if each has one."""
        estimated = [rate for rate in rates if rate is not None]
        return combined(estimated, shares) if len(estimated) == len(rates) else None

    sampled = {}
    for kind in scenarios[0].sampled:
        rate = together([judged.sampled.get(kind) for judged in scenarios])
        if rate is not None:
            sampled[kind] = rate
    missing = next((judged.missing for judged in scenarios if judged.missing), "")
    failure = together([judged.failure for judged in scenarios])
    hidden = together([judged.hidden for judged in scenarios])
    return Whole(
        shares=dict(zip(names, shares, strict=True)),
        failure=_risk(FAILURE, failure, NO_RANDOM),
        areas=_areas(sampled, hidden, missing),
    )


def _open_region(region: FailureRegion, share: Rate) -> OpenRegion:
    """A failure region as evidence. share: of the exposure inside its rule."""
    worst = {test.role: test.test_id for test in region.representatives}
    return OpenRegion(
        name=region.name,
        rule=region.rule,
        conditions=region.conditions,
        cause=region.cause,
        status=region.status,
        confirmation=region.confirmation,
        failures=len(region.members),
        worst=worst.get("worst", worst["medoid"]),
        share=_estimate(share),
    )


def _areas(sampled: Mapping[str, Rate], hidden: Rate | None, missing: str) -> Areas:
    empty = {
        "known_unsafe": KNOWN_UNSAFE,
        "confirmed": CONFIRMED,
        "known_safe": KNOWN_SAFE,
        "unknown": UNKNOWN,
    }
    areas = {}
    for name, area in empty.items():
        if name in sampled:
            areas[name] = area.model_copy(update={"share": _estimate(sampled[name])})
    areas.setdefault("confirmed", CONFIRMED.model_copy(update={"missing": UNCONFIRMED}))
    return Areas(**areas, unknown_unsafe=_risk(UNKNOWN_UNSAFE, hidden, missing))


def _risk(empty: Risk, rate: Rate | None, missing: str) -> Risk:
    if rate is None:
        return empty.model_copy(update={"missing": missing})
    counts = {
        "tests": rate.tests,
        "failures": rate.failures,
        "errors": rate.errors,
        "below": rate.limits.below,
    }
    note = f"{empty.source} {rate.note[0].upper()}{rate.note[1:]}." if rate.note else empty.source
    return empty.model_copy(update={"share": _estimate(rate), "source": note, **counts})


def _estimate(rate: Rate) -> Estimate:
    return Estimate(value=rate.value, low=rate.limits.low, high=rate.limits.high)
