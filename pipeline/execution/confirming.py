"""Confirms the rules of failure regions by fresh random tests, which no search has seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.analysis.failure_regions import GroupedRegion
from pipeline.artefacts.region_results import Confirmation, FailureRegion, Fresh
from pipeline.artefacts.results import Estimate
from pipeline.core.confirmation import (
    NarrowError,
    confirmed,
    draw_inside,
    draw_just_outside,
    more_inside,
)
from pipeline.core.counted import Counted
from pipeline.core.space import Floats, Space
from pipeline.execution.journal import Outcome
from pipeline.execution.points import Executor


def counted(outcomes: Sequence[Outcome], failure_threshold_s: float) -> Counted:
    """Tests and failures of some outcomes; errors are in neither number."""
    error = np.array([outcome.is_error for outcome in outcomes], bool)
    failed = [outcome.kpi(failure_threshold_s).failure for outcome in outcomes]
    return Counted.of(np.array(failed, bool), error)


@dataclass(frozen=True)
class FreshTests:
    """What confirms rules. tests: inside each rule, and as many just outside."""

    space: Space
    executor: Executor
    failure_threshold_s: float
    tests: int
    confidence: float

    def confirm(self, regions: Sequence[GroupedRegion]) -> tuple[FailureRegion, ...]:
        """The regions with their confirmations.

        All rules together are confirmed with an error of at most 1 - confidence.
        """
        drawn = [points for region in regions for points in self._drawn(region)]
        tests = [self.space.decode(point) for points in drawn for point in points]
        outcomes = self.executor.outcomes(tests) if drawn else []
        counts: list[Counted] = []
        start = 0
        for points in drawn:
            end = start + len(points)
            counts.append(counted(outcomes[start:end], self.failure_threshold_s))
            start = end
        pairs = list(zip(counts[::2], counts[1::2], strict=True))
        status = confirmed(pairs, 1 - self.confidence)
        return tuple(
            self._with(region.region, *pair, holds)
            for region, pair, holds in zip(regions, pairs, status, strict=True)
        )

    def _drawn(self, region: GroupedRegion) -> tuple[Floats, Floats]:
        """Points inside and just outside a rule.

        There are none of either if the constraints leave hardly any inside, so that the rule stays
        unconfirmed.
        """
        rng, rule = region.rng("confirm"), region.group.rule
        try:
            inside = draw_inside(self.space, rule, self.tests, rng)
            return inside, draw_just_outside(self.space, rule, self.tests, rng)
        except NarrowError:
            return np.zeros((0, len(self.space))), np.zeros((0, len(self.space)))

    def _with(
        self, region: FailureRegion, inside: Counted, outside: Counted, holds: bool
    ) -> FailureRegion:
        confirmation = Confirmation(
            confidence=self.confidence,
            inside=self._fresh(inside),
            outside=self._fresh(outside),
            p_value=more_inside(inside, outside),
        )
        status = "confirmed" if holds else "not confirmed"
        return region.model_copy(update={"confirmation": confirmation, "status": status})

    def _fresh(self, counted: Counted) -> Fresh:
        rate = Estimate.of(counted, self.confidence)
        return Fresh(
            tests=counted.tests, failures=counted.failures, errors=counted.errors, rate=rate
        )
