"""Executes the failures of regions again, each with one change at a time, to see which change repairs them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import reduce
from typing import Any

import pandas as pd

from pipeline.analysis.failure_regions import Found
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

    def chosen(self, found: Found, rows: pd.DataFrame, outcomes: Outcomes) -> list[Failure]:
        """Failures of a region, drawn at random without repeats. rows: of tests.parquet, by test_id."""
        region = found.region
        count = min(self.tests, len(region.members))
        drawn = found.rng("explain").choice(len(region.members), count, replace=False)
        names = [region.members[i] for i in sorted(drawn)]
        return [
            Failure(region.name, name, concrete(rows.loc[name], outcomes.space)) for name in names
        ]

    def planned(
        self,
        found: Found,
        failures: Sequence[Failure],
        outcomes: Outcomes,
        signals: Mapping[str, Signals],
    ) -> tuple[Change, ...]:
        """The changes that change any of a region's chosen failures, and the control, which comes last."""
        hiding = reduce(
            frozenset.union,
            (occluders(self._scenario, signals[one.test_id]) for one in failures),
            frozenset[str](),
        )
        wanted = (*changes(outcomes, found.group.members), *without(self._scenario, sorted(hiding)))
        moved = [
            c
            for c in wanted
            if c.without
            or any(one.concrete[k] != v for one in failures for k, v in c.values.items())
        ]
        return (*moved, CONTROL)

    @property
    def _scenario(self) -> FunctionalScenario:
        return self.executor.setup.scenario

    def rows(
        self, plans: Sequence[tuple[Sequence[Failure], Sequence[Change]]], outcomes: Outcomes
    ) -> list[dict[str, Any]]:
        """The rows of all failures with all changes of their regions; changes that break a constraint are left out."""
        wanted = [
            _Changed(one, change, changed)
            for failures, made in plans
            for change in made
            for one in failures
            if (changed := change.of(one.concrete, outcomes.space)) is not None
        ]
        worlds = dict.fromkeys(one.change.without for one in wanted)
        return [
            row
            for actors in worlds
            for row in self._executed([w for w in wanted if w.change.without == actors])
        ]

    def _executed(self, wanted: Sequence[_Changed]) -> list[dict[str, Any]]:
        """The rows of changes that remove the same actors."""
        actors = wanted[0].change.without
        kept = {name: actor for name, actor in self._scenario.actors.items() if name not in actors}
        setup = replace(
            self.executor.setup, scenario=self._scenario.model_copy(update={"actors": kept})
        )
        noises = [one.noise for one in wanted]
        executor = replace(
            self.executor,
            setup=setup,
            journal=self.executor.journal / "-".join(["without", *actors]),
        )
        outcomes = executor.outcomes([one.concrete for one in wanted], noises)
        return [self._row(one, outcome) for one, outcome in zip(wanted, outcomes, strict=True)]

    def _row(self, one: _Changed, outcome: Outcome) -> dict[str, Any]:
        row = {
            "region": one.failure.region,
            "test_id": one.failure.test_id,
            "change": one.change.text,
        }
        kpi = outcome.kpi(self.failure_threshold_s)
        judged = {
            "status": outcome.status,
            "reason": outcome.reason,
            "failure": kpi.failure,
            "adj_ttc_s": kpi.adj_ttc_s,
        }
        return {**row, **judged, **asdict(Sight() if outcome.is_error else sight(outcome.signals))}


def table(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Rows as the table beside a scenario's regions."""
    return pd.DataFrame(rows, columns=[column.name for column in WHY])
