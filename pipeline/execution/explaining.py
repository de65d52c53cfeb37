"""Executes the failures of regions again, with one change at a time, to see which one helps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

import pandas as pd

from pipeline.analysis.failure_regions import GroupedRegion
from pipeline.artefacts.points import concrete
from pipeline.artefacts.tables import WHY
from pipeline.core.grouping import Outcomes
from pipeline.core.sight import Sight, sight
from pipeline.core.signals import Signals
from pipeline.core.space import Value
from pipeline.execution.journal import Outcome
from pipeline.execution.points import Executor
from pipeline.scenarios.changes import CONTROL, Change, changes, without
from pipeline.scenarios.functional import FunctionalScenario
from pipeline.scenarios.occluders import occluders


@dataclass(frozen=True)
class Failure:
    """A failure of a region as it was executed."""

    region: str
    test_id: str
    concrete: Mapping[str, Value]


@dataclass(frozen=True)
class _Changed:
    """A failure to execute with a change. concrete: with the change."""

    failure: Failure
    change: Change
    concrete: Mapping[str, Value]

    @property
    def noise(self) -> Mapping[str, Value]:
        """The failure's own noise, or, for the control, other noise."""
        return (
            {**self.failure.concrete, "noise": "other"}
            if self.change.is_control
            else self.failure.concrete
        )


@dataclass(frozen=True)
class Counterfactuals:
    """What executes failures with changes. tests: the largest number of a region's failures."""

    executor: Executor
    failure_threshold_s: float
    tests: int

    def chosen(
        self, failure_region: GroupedRegion, rows: pd.DataFrame, outcomes: Outcomes
    ) -> list[Failure]:
        """Draw failures of a region at random, without repeats.

        Args:
            failure_region: the region, with its group.
            rows: of tests.parquet, indexed by test_id.
            outcomes: of the same tests.
        """
        region = failure_region.region
        count = min(self.tests, len(region.members))
        drawn = failure_region.rng("explain").choice(len(region.members), count, replace=False)
        names = [region.members[i] for i in sorted(drawn)]
        return [
            Failure(region.name, name, concrete(rows.loc[name], outcomes.space)) for name in names
        ]

    def planned(
        self,
        failure_region: GroupedRegion,
        failures: Sequence[Failure],
        outcomes: Outcomes,
        signals: Mapping[str, Signals],
    ) -> tuple[Change, ...]:
        """The changes that change any of the chosen failures, and the control, which comes last."""
        hiding: set[str] = set()
        for failure in failures:
            hiding |= occluders(self._scenario, signals[failure.test_id])
        candidates = changes(outcomes, failure_region.group.members)
        moved = [change for change in candidates if _changes_any(change, failures)]
        return (*moved, *without(self._scenario, sorted(hiding)), CONTROL)

    @property
    def _scenario(self) -> FunctionalScenario:
        return self.executor.setup.scenario

    def rows(
        self, plans: Sequence[tuple[Sequence[Failure], Sequence[Change]]], outcomes: Outcomes
    ) -> list[dict[str, Any]]:
        """The rows of all failures with all changes of their regions.

        Changes that break a constraint are left out.
        """
        # Tests without the same actors share a world.
        of_world: dict[tuple[str, ...], list[_Changed]] = {}
        for failures, planned in plans:
            for change, failure in product(planned, failures):
                changed = change.of(failure.concrete, outcomes.space)
                if changed is not None:
                    tests = of_world.setdefault(change.without, [])
                    tests.append(_Changed(failure, change, changed))
        return [row for tests in of_world.values() for row in self._executed(tests)]

    def _executed(self, tests: Sequence[_Changed]) -> list[dict[str, Any]]:
        """The rows of changes that remove the same actors."""
        actors = tests[0].change.without
        kept = {name: actor for name, actor in self._scenario.actors.items() if name not in actors}
        scenario = self._scenario.model_copy(update={"actors": kept})
        executor = replace(
            self.executor,
            setup=replace(self.executor.setup, scenario=scenario),
            journal=self.executor.journal / "-".join(["without", *actors]),
        )
        points, noises = [test.concrete for test in tests], [test.noise for test in tests]
        outcomes = executor.outcomes(points, noises)
        return [self._row(test, outcome) for test, outcome in zip(tests, outcomes, strict=True)]

    def _row(self, test: _Changed, outcome: Outcome) -> dict[str, Any]:
        kpi = outcome.kpi(self.failure_threshold_s)
        return {
            "region": test.failure.region,
            "test_id": test.failure.test_id,
            "change": test.change.text,
            "status": outcome.status,
            "reason": outcome.reason,
            "failure": kpi.failure,
            "adj_ttc_s": kpi.adj_ttc_s,
            **asdict(Sight() if outcome.is_error else sight(outcome.signals)),
        }


def _changes_any(change: Change, failures: Sequence[Failure]) -> bool:
    """Whether a change of values changes any of the failures."""
    return any(
        failure.concrete[name] != value
        for failure in failures
        for name, value in change.values.items()
    )


def table(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Rows as the table beside a scenario's regions."""
    return pd.DataFrame(rows, columns=[column.name for column in WHY])
