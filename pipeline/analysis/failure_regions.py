"""A scenario's failure regions, from the tables of its campaigns (thesis Def. 4.18, 4.19)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.analysis.measures import count_modes
from pipeline.analysis.named_groups import named_groups
from pipeline.artefacts.failure_counts import Count
from pipeline.artefacts.points import concrete, encode_tests
from pipeline.artefacts.region_results import (
    FailureRegion,
    FailureRegions,
    Representative,
    Role,
    RuleCondition,
)
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.config.sections import Regions
from pipeline.core.distance import mixed_distance
from pipeline.core.grouping import Group, Outcomes, group_failures, held_back
from pipeline.core.regions import connected_failures, medoid
from pipeline.core.rules import Condition
from pipeline.core.space import Floats, Space
from pipeline.scenarios.people import WORDS


@dataclass(frozen=True)
class Found:
    """A region as the artefact and the report know it, and its group with the rule."""

    region: FailureRegion
    group: Group

    def rng(self, purpose: str) -> np.random.Generator:
        """Random numbers for tests of the region: the same for the same purpose, name and rule."""
        digest = hashlib.sha256(
            f"{purpose} {self.region.name} {self.region.rule}".encode()
        ).digest()
        return np.random.default_rng(int.from_bytes(digest[:8], "big"))


@dataclass(frozen=True)
class _Tested:
    """Valid rows of one scenario, and their points and outcomes."""

    rows: pd.DataFrame
    outcomes: Outcomes


def find_regions(
    info: ScenarioInfo, space: Space, tests: pd.DataFrame, section: Regions
) -> list[Found]:
    """The failure regions of one scenario, larger ones first; tests: its valid rows."""
    outcomes = outcomes_of(space, tests)
    groups = group_failures(
        outcomes, tests["cause"].to_numpy(str), section.chance_neighbours, section.min_failures
    )
    tested = _Tested(tests, outcomes)
    return [
        Found(_region(f"{info.label} region {number}", tested, group), group)
        for number, group in enumerate(groups, 1)
    ]


def outcomes_of(space: Space, tests: pd.DataFrame) -> Outcomes:
    """The points and outcomes of valid rows of tests.parquet, with the words that rules use."""
    return Outcomes(space, encode_tests(tests, space), tests["failure"].to_numpy(bool), WORDS)


def cluster(
    info: ScenarioInfo, space: Space, tests: pd.DataFrame, section: Regions
) -> FailureRegions:
    """The failure regions of one scenario and the failures outside them; tests: its valid rows."""
    return regions_of(info, space, tests, find_regions(info, space, tests, section))


def regions_of(
    info: ScenarioInfo, space: Space, tests: pd.DataFrame, found: Sequence[Found]
) -> FailureRegions:
    """The artefact of the regions that `find_regions` found in the same tests."""
    failed, points = tests["failure"].to_numpy(bool), encode_tests(tests, space)
    regions = tuple(one.region for one in found)
    members = {test for region in regions for test in region.members}
    return FailureRegions(
        scenario=info.name,
        label=info.label,
        tests=len(tests),
        failures=int(failed.sum()),
        failure_rate=float(failed.mean()) if len(tests) else 0.0,
        connected=len(np.unique(connected_failures(space, points[failed]))),
        regions=regions,
        isolated=tuple(test for test in tests.loc[failed, "test_id"] if test not in members),
        not_solvable=tuple(tests.loc[tests["cause"] == "not_solvable", "test_id"]),
    )


def _region(name: str, tested: _Tested, group: Group) -> FailureRegion:
    outcomes, members, rows = tested.outcomes, group.members, tested.rows[group.members]
    inside = group.rule.holds(outcomes.points)
    support, hits = int(inside.sum()), int((inside & outcomes.failed).sum())
    tests, failures = held_back(outcomes, group)
    return FailureRegion(
        name=name,
        cause=group.cause,
        members=tuple(rows["test_id"]),
        modes=count_modes(rows),
        strategies={
            str(key): int(count)
            for key, count in rows["strategy"].value_counts().sort_index().items()
        },
        rule=group.rule.text(outcomes.space),
        conditions=tuple(
            _condition(outcomes.space, condition) for condition in group.rule.conditions
        ),
        support=support,
        failures_inside=hits,
        precision=hits / support,
        lift=hits / support / float(outcomes.failed.mean()),
        recall=float(inside[members].mean()),
        held_back=Count(tests=tests, failures=failures),
        groups=tuple(
            name
            for name, belongs in named_groups(outcomes.space, outcomes.points[inside]).items()
            if belongs.all()
        ),
        representatives=_representatives(outcomes.space, rows, outcomes.points[members]),
    )


def _condition(space: Space, condition: Condition) -> RuleCondition:
    variable, text = condition.subject(space), condition.words(space)
    if condition.values:
        return RuleCondition(
            variable=variable.name,
            text=text,
            values=tuple(variable.values[i] for i in condition.values),
        )
    return RuleCondition(variable=variable.name, text=text, low=condition.low, high=condition.high)


def _representatives(
    space: Space, rows: pd.DataFrame, points: Floats
) -> tuple[Representative, ...]:
    """The medoid, the worst failure and the failure furthest from the medoid; each test appears once."""
    centre = medoid(space, points)
    # The worst is the hardest contact; without a contact, the smallest adjusted TTC.
    severity = np.lexsort(
        (rows["adj_ttc_s"].to_numpy(), -rows["impact_speed_mps"].fillna(0).to_numpy())
    )
    furthest = int(np.argmax(mixed_distance(space, points[[centre]], points)[0]))
    ranked: list[tuple[int, Role]] = [
        (furthest, "furthest"),
        (int(severity[0]), "worst"),
        (centre, "medoid"),
    ]
    # Later entries win, so a test in two roles keeps the medoid's; the result starts with the medoid.
    roles = dict(reversed(list({position: (position, role) for position, role in ranked}.values())))
    return tuple(
        _representative(rows.iloc[position], role, space) for position, role in roles.items()
    )


def _representative(row: pd.Series, role: Role, space: Space) -> Representative:
    return Representative(
        test_id=row["test_id"],
        role=role,
        strategy=row["strategy"],
        seed=int(row["seed"]),
        adj_ttc_s=float(row["adj_ttc_s"]),
        concrete=concrete(row, space),
    )
