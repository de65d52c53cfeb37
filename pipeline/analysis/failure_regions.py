"""A scenario's failure regions, from the tables of its campaigns (thesis Def. 4.18, 4.19)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

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
from pipeline.core.space import Floats, Space
from pipeline.scenarios.people import WORDS


@dataclass(frozen=True)
class GroupedRegion:
    """A region as the artefact stores it, and its group with the rule."""

    region: FailureRegion
    group: Group

    def rng(self, purpose: str) -> np.random.Generator:
        """Random numbers for tests of the region: the same for the same purpose, name and rule."""
        text = f"{purpose} {self.region.name} {self.region.rule}"
        digest = hashlib.sha256(text.encode()).digest()
        return np.random.default_rng(int.from_bytes(digest[:8], "big"))


def find_regions(
    info: ScenarioInfo, space: Space, tests: pd.DataFrame, section: Regions
) -> list[GroupedRegion]:
    """The failure regions of one scenario, larger ones first.

    Args:
        info: The scenario.
        space: Its space.
        tests: Its valid rows of tests.parquet.
        section: Settings of the search for regions.
    """
    outcomes, causes = outcomes_of(space, tests), tests["cause"].to_numpy(str)
    groups = group_failures(outcomes, causes, section.chance_neighbours, section.min_failures)
    regions = []
    for number, group in enumerate(groups, 1):
        region = _region(f"{info.label} region {number}", tests, outcomes, group)
        regions.append(GroupedRegion(region, group))
    return regions


def outcomes_of(space: Space, tests: pd.DataFrame) -> Outcomes:
    """The points and outcomes of valid rows of tests.parquet, with the words that rules use."""
    return Outcomes(space, encode_tests(tests, space), tests["failure"].to_numpy(bool), WORDS)


def cluster(
    info: ScenarioInfo, space: Space, tests: pd.DataFrame, section: Regions
) -> FailureRegions:
    """The failure regions of one scenario and the failures outside them; tests: its valid rows."""
    return regions_of(info, space, tests, find_regions(info, space, tests, section))


def regions_of(
    info: ScenarioInfo, space: Space, tests: pd.DataFrame, grouped: Sequence[GroupedRegion]
) -> FailureRegions:
    """The artefact of the regions that `find_regions` returns for the same tests."""
    failed, points = tests["failure"].to_numpy(bool), encode_tests(tests, space)
    regions = tuple(group.region for group in grouped)
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


def _region(name: str, tests: pd.DataFrame, outcomes: Outcomes, group: Group) -> FailureRegion:
    """A region as the artefact stores it. tests: valid rows of the scenario."""
    space, members, rows = outcomes.space, group.members, tests[group.members]
    inside = group.rule.holds(outcomes.points)
    support, hits = int(inside.sum()), int((inside & outcomes.failed).sum())
    number, failures = held_back(outcomes, group)
    strategies = rows["strategy"].value_counts().sort_index()
    groups = named_groups(space, outcomes.points[inside])
    conditions = []
    for condition in group.rule.conditions:
        variable, text = condition.subject(space), condition.words(space)
        bounds: dict[str, Any] = {"low": condition.low, "high": condition.high}
        if condition.values:
            bounds = {"values": tuple(variable.values[i] for i in condition.values)}
        conditions.append(RuleCondition(variable=variable.name, text=text, **bounds))
    return FailureRegion(
        name=name,
        cause=group.cause,
        members=tuple(rows["test_id"]),
        modes=count_modes(rows),
        strategies={str(strategy): int(count) for strategy, count in strategies.items()},
        rule=group.rule.text(space),
        conditions=tuple(conditions),
        support=support,
        failures_inside=hits,
        precision=hits / support,
        lift=hits / support / float(outcomes.failed.mean()),
        recall=float(inside[members].mean()),
        held_back=Count(tests=number, failures=failures),
        groups=tuple(name for name, belongs in groups.items() if belongs.all()),
        representatives=_representatives(space, rows, outcomes.points[members]),
    )


def _representatives(
    space: Space, rows: pd.DataFrame, points: Floats
) -> tuple[Representative, ...]:
    """The medoid, the worst failure and the failure furthest from the medoid, each test once."""
    centre = medoid(space, points)
    # The worst is the hardest contact; without a contact, the smallest adjusted TTC.
    speed_mps = rows["impact_speed_mps"].fillna(0).to_numpy()
    severity = np.lexsort((rows["adj_ttc_s"].to_numpy(), -speed_mps))
    furthest = int(np.argmax(mixed_distance(space, points[[centre]], points)[0]))
    # A test in two roles keeps the later role here; the result starts with the medoid.
    roles: dict[int, Role] = {furthest: "furthest"}
    roles[int(severity[0])] = "worst"
    roles[centre] = "medoid"
    representatives = []
    for position, role in reversed(roles.items()):
        row = rows.iloc[position]
        representative = Representative(
            test_id=row["test_id"],
            role=role,
            strategy=row["strategy"],
            seed=int(row["seed"]),
            adj_ttc_s=float(row["adj_ttc_s"]),
            concrete=concrete(row, space),
        )
        representatives.append(representative)
    return tuple(representatives)
