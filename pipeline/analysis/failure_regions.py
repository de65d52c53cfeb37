"""A scenario's failure regions, from the tables of its campaigns (thesis Def. 4.18, 4.19)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.analysis.measures import count_modes
from pipeline.analysis.named_groups import named_groups
from pipeline.artefacts.points import concrete, encode_tests
from pipeline.artefacts.results import FailureRegion, FailureRegions, Representative, Role
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.config.sections import Regions
from pipeline.core.distance import mixed_distance
from pipeline.core.growth import PointOutcomes, readable_regions
from pipeline.core.regions import NOISE, chance_radius, connected_failures, medoid
from pipeline.core.rules import find_rule
from pipeline.core.space import Floats, Space

Bools = NDArray[np.bool_]


MIN_RULE_PRECISION = 0.75


@dataclass(frozen=True)
class _Tested:
    """Valid rows of one scenario, and their points (n, d) and failures (n,)."""

    space: Space
    rows: pd.DataFrame
    points: Floats
    failed: Bools


def cluster(info: ScenarioInfo, space: Space, tests: pd.DataFrame, section: Regions) -> FailureRegions:
    """Density clusters of the failures over the mixed distance, each with its rule; tests: valid rows of one scenario."""
    points, failed = encode_tests(tests, space), tests["failure"].to_numpy(bool)
    radius = chance_radius(space, int(failed.sum()), section.chance_neighbours)
    labels = readable_regions(PointOutcomes(space, points, failed), radius, MIN_RULE_PRECISION, section.min_failures)
    connected = connected_failures(space, points[failed])
    tested = _Tested(space, tests, points, failed)
    regions = [_region(f"{info.label} region {label + 1}", tested, labels == label) for label in range(int(labels.max(initial=NOISE)) + 1)]
    return FailureRegions(
        scenario=info.name,
        label=info.label,
        tests=len(tests),
        failures=int(failed.sum()),
        failure_rate=float(failed.mean()) if len(tests) else 0.0,
        connected=len(np.unique(connected)),
        regions=tuple(regions),
        unassigned=tuple(tests.loc[failed & (labels == NOISE), "test_id"]),
        not_solvable=tuple(tests.loc[tests["cause"] == "not_solvable", "test_id"]),
    )


def _region(name: str, tested: _Tested, members: Bools) -> FailureRegion:
    rule = find_rule(tested.space, tested.points, tested.failed, members)
    inside = rule.holds(tested.points)
    support, hits = int(inside.sum()), int((inside & tested.failed).sum())
    rows = tested.rows[members]
    return FailureRegion(
        name=name,
        members=tuple(rows["test_id"]),
        modes=count_modes(rows),
        strategies={str(key): int(count) for key, count in rows["strategy"].value_counts().sort_index().items()},
        rule=rule.text(tested.space),
        support=support,
        failures_inside=hits,
        precision=hits / max(1, support),
        recall=float(inside[members].mean()),
        groups=tuple(name for name, belongs in named_groups(tested.space, tested.points[inside]).items() if belongs.all()),
        representatives=_representatives(tested.space, rows, tested.points[members]),
    )


def _representatives(space: Space, rows: pd.DataFrame, points: Floats) -> tuple[Representative, ...]:
    """The medoid, the worst failure and the failure furthest from the medoid; each test appears once."""
    centre = medoid(space, points)
    # The worst is the hardest contact; without a contact, the smallest adjusted TTC.
    severity = np.lexsort((rows["adj_ttc_s"].to_numpy(), -rows["impact_speed_mps"].fillna(0).to_numpy()))
    furthest = int(np.argmax(mixed_distance(space, points[[centre]], points)[0]))
    ranked: list[tuple[int, Role]] = [(furthest, "furthest"), (int(severity[0]), "worst"), (centre, "medoid")]
    # Later entries win, so a test in two roles keeps the medoid's; the result starts with the medoid.
    roles = dict(reversed(list({position: (position, role) for position, role in ranked}.values())))
    return tuple(_representative(rows.iloc[position], role, space) for position, role in roles.items())


def _representative(row: pd.Series, role: Role, space: Space) -> Representative:
    return Representative(
        test_id=row["test_id"],
        role=role,
        strategy=row["strategy"],
        seed=int(row["seed"]),
        adj_ttc_s=float(row["adj_ttc_s"]),
        concrete=concrete(row, space),
    )
