"""The areas of the thesis' Figure 8.1, known or unknown and safe or unsafe (ISO 21448), estimated from a study's tests.

Known areas come from all tests. Rates come from random tests alone, judged by rules that were fitted without them.
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
from pipeline.core.rules import Bools, Rule
from pipeline.core.shown import shown_share
from pipeline.core.space import Floats, Space
from pipeline.errors import InputError

DRAWS = 100_000
"""Conditions drawn from the exposure to measure a share; no test is executed for them."""
NORMAL, ONE_SIDED = (NormalDist().inv_cdf(1 - tail) for tail in (TAIL, 2 * TAIL))
"""In standard errors: half the width of an interval, and the distance of a one-sided limit."""
NO_RANDOM = "no random test was executed, and the tests of other strategies give no rate"
UNCONFIRMED = "no rule was tested by fresh random tests; regions.confirm says how many to execute"
ONLY_RANDOM = "every test is random: rules that are fitted to these tests cannot be judged by them; add a search to the strategies"
SAMPLED = f"{DRAWS:,} conditions drawn from the exposure; "
OUTSIDE = f"Conditions outside all rules, times the share of their {PROJECTION_K}-combinations of categories"
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
    """What is known of one scenario. tests: rows of all campaigns against the detector, its audit included. independent:
    strategies whose tests are random."""

    info: ScenarioInfo
    space: Space
    tests: pd.DataFrame
    regions: FailureRegions
    independent: frozenset[str]

    @property
    def valid(self) -> pd.DataFrame:
        return self.tests[is_valid(self.tests)]

    def rows(self, random: bool) -> pd.DataFrame:
        """The valid tests that are random, or the others, of which each counts once."""
        rows = self.valid[self.valid["strategy"].isin(self.independent) == random]
        return (rows if random else rows.drop_duplicates(list(self.space.names))).reset_index(
            drop=True
        )


@dataclass(frozen=True)
class Judged:
    """The shares of one scenario as rates, which can be combined with those of others; a share without an estimate is None or left out."""

    tested: Searched
    sampled: Mapping[str, Rate]
    regions: Mapping[str, Rate]
    failure: Rate | None
    hidden: Rate | None
    missing: str


def judged(tested: Searched, section: Regions, exposure: ExposureFile) -> Judged:
    """The shares of one scenario. section: how its regions were found."""
    road = exposure.of(tested.info.name, tested.space)
    points = road.sample(DRAWS, np.random.default_rng(0))
    inside = {
        region.name: stored_rule(tested.space, region.conditions).holds(points)
        for region in tested.regions.regions
    }
    failure, hidden, missing = _risks(tested, section, None if exposure.uniform else road)
    shares = {name: share_of(holds) for name, holds in inside.items()}
    return Judged(tested, _sampled(tested, points, inside), shares, failure, hidden, missing)


def _sampled(tested: Searched, points: Floats, inside: Mapping[str, Bools]) -> dict[str, Rate]:
    """The areas that need no random test, from points (n, d) of the exposure and whether each is inside each rule."""
    regions = tested.regions.regions
    confirmed = [inside[region.name] for region in regions if region.status == "confirmed"]
    asked = not regions or any(region.confirmation for region in regions)
    known = _any([*inside.values()], len(points))
    passed = tested.valid[~tested.valid["failure"].to_numpy(bool)]
    seen = tested.space.categorise(encode_tests(passed, tested.space))
    shown = shown_share(tested.space.sizes, seen, tested.space.categorise(points), PROJECTION_K)
    return {
        "known_unsafe": share_of(known),
        **({"confirmed": share_of(_any(confirmed, len(points)))} if asked else {}),
        "known_safe": mean_of(shown * ~known),
        "unknown": mean_of((1 - shown) * ~known),
    }


def _any(holds: Sequence[Bools], count: int) -> Bools:
    return np.any(holds, axis=0) if holds else np.zeros(count, bool)


def _risks(
    tested: Searched, section: Regions, road: Exposure | None
) -> tuple[Rate | None, Rate | None, str]:
    """The failure probability, that outside all rules, and why the second is missing. road: None if random tests are the exposure's."""
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
    inside = [rule.holds(points) for rule in _searched_rules(tested.space, others, section)]
    return rate(failed), rate(failed & ~_any(inside, len(points))), ""


def _searched_rules(space: Space, tests: pd.DataFrame, section: Regions) -> list[Rule]:
    """The rules of the failure regions of some tests."""
    groups = group_failures(
        outcomes_of(space, tests),
        tests["cause"].to_numpy(str),
        section.chance_neighbours,
        section.min_failures,
    )
    return [group.rule for group in groups]


def share_of(holds: Bools) -> Rate:
    """The share of drawn conditions that hold, with its exact interval."""
    count = int(holds.sum())
    return Rate(count / len(holds), exact(count, len(holds)), len(holds), count)


def mean_of(shares: Floats) -> Rate:
    """The mean of a share over drawn conditions, with its normal interval; with the exact one if all are 0 or all are 1."""
    value, error = float(shares.mean()), float(shares.std()) / np.sqrt(len(shares))
    if not error and value in (0.0, 1.0):
        return share_of(shares == 1)
    low, high, below = value - NORMAL * error, value + NORMAL * error, value + ONE_SIDED * error
    return Rate(value, Limits(max(0.0, low), min(1.0, high), min(1.0, below)), len(shares), 0)


def scenario_evidence(found: Judged) -> ScenarioEvidence:
    """The artefact of one scenario."""
    tested = found.tested
    clauses = tuple((one,) if isinstance(one, str) else one for one in tested.space.clauses)
    info = tested.info
    return ScenarioEvidence(
        domain=Domain(
            scenario=info.name,
            label=info.label,
            description=info.description,
            variables=tested.space.to_dict(),
            constraints=clauses,
        ),
        coverage=_coverage(tested),
        failure=_risk(FAILURE, found.failure, NO_RANDOM),
        areas=_areas(found.sampled, found.hidden, found.missing),
        open_regions=tuple(
            _open(region, found.regions[region.name]) for region in tested.regions.regions
        ),
        isolated_failures=len(tested.regions.isolated),
    )


def whole(found: Sequence[Judged], exposure: ExposureFile) -> Whole | None:
    """All scenarios together; None if the exposure does not say how often each occurs."""
    names = [one.tested.info.name for one in found]
    try:
        shares = exposure.shares(names)
    except InputError:
        return None
    kinds = [kind for kind in found[0].sampled if all(kind in one.sampled for one in found)]
    sampled = {kind: combined([one.sampled[kind] for one in found], shares) for kind in kinds}
    missing = next((one.missing for one in found if one.missing), "")
    failure, hidden = (
        _all([one.failure for one in found], shares),
        _all([one.hidden for one in found], shares),
    )
    areas = _areas(sampled, hidden, missing)
    return Whole(
        shares=dict(zip(names, shares, strict=True)),
        failure=_risk(FAILURE, failure, NO_RANDOM),
        areas=areas,
    )


def _all(rates: Sequence[Rate | None], shares: Sequence[float]) -> Rate | None:
    known = [rate for rate in rates if rate is not None]
    return combined(known, shares) if len(known) == len(rates) else None


def _coverage(tested: Searched) -> Coverage:
    categories = tested.space.categorise(encode_tests(tested.valid, tested.space))
    reached = projection_coverage(categories, Demand(tested.space.constraints, PROJECTION_K))
    return Coverage(
        k=PROJECTION_K,
        covered=reached.covered,
        required=reached.required,
        ratio=reached.ratio,
        tests=len(categories),
    )


def _open(region: FailureRegion, share: Rate) -> OpenRegion:
    named = {
        name: getattr(region, name)
        for name in ("name", "rule", "conditions", "cause", "status", "confirmation")
    }
    worst = {one.role: one.test_id for one in region.representatives}
    return OpenRegion(
        **named,
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
    areas = {
        name: area.model_copy(update={"share": _estimate(sampled[name])})
        for name, area in empty.items()
        if name in sampled
    }
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
