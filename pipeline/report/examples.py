"""Which tests the report shows: as stills before and after retraining, and as replays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import pandas as pd

from pipeline.analysis.named_groups import named_groups
from pipeline.artefacts.comparison_results import Comparison, VersionPair
from pipeline.artefacts.points import concrete, encode_tests
from pipeline.artefacts.region_results import FailureRegions
from pipeline.core.comparison import SequenceTest
from pipeline.core.space import Space, Value

ROLES = {
    "medoid": "most typical failure",
    "worst": "worst failure",
    "furthest": "most unusual failure",
}


@dataclass(frozen=True)
class Chosen:
    """One test to replay with one version. heading: first line on the film; reason: why it was chosen. region: that it represents."""

    test_id: str
    scenario: str
    version: str
    heading: str
    reason: str
    concrete: Mapping[str, Value]
    region: str = ""


@dataclass(frozen=True)
class Fix:
    """A test that `before` fails and `after` passes. groups: the named groups that it belongs to."""

    groups: tuple[str, ...]
    before: Chosen
    after: Chosen


def choose_regions(found: Sequence[FailureRegions], version: str, limit: int) -> list[Chosen]:
    """At most `limit` representatives, scenarios in turn: the medoids of all regions, largest region first, then the other roles."""
    queues = []
    for regions in found:
        ranked = [
            (region, r)
            for role in ROLES
            for region in regions.regions
            for r in region.representatives
            if r.role == role
        ]
        queues.append(
            [
                Chosen(
                    r.test_id,
                    regions.scenario,
                    version,
                    f"{regions.label} · {r.strategy} · seed {r.seed} · {r.test_id.rsplit('-', 1)[1]}",
                    f"The {ROLES[r.role]} of {region.name}.",
                    r.concrete,
                    region.name,
                )
                for region, r in ranked
            ]
        )
    return [chosen for turn in zip_longest(*queues) for chosen in turn if chosen is not None][
        :limit
    ]


def choose_regression(
    comparison: Comparison, table: pd.DataFrame, spaces: Mapping[str, Space]
) -> list[Chosen]:
    """A regression of one retrained version, with base and that version, in this order: the champion's, or that of the version with the
    fewest failures that changes any outcome.

    table: rows of comparison.parquet. Empty without a regression.
    """
    paired = next((pair for pair in _ranked(comparison) if pair.fixes or pair.regressions), None)
    if paired is None or not paired.regressions:
        return []
    return _both(comparison, paired, (paired.regressions[0], "regression"), table, spaces)


def choose_fixes(
    comparison: Comparison, table: pd.DataFrame, spaces: Mapping[str, Space], limit: int
) -> list[Fix]:
    """At most `limit` fixes of one retrained version: the champion, or the one with the fewest failures that has any. They cover as many
    groups that the base set shows rarely as possible, then as many other named groups; the first in the sequence wins a tie."""
    paired = next((pair for pair in _ranked(comparison) if pair.fixes), None)
    if paired is None:
        return []
    rare = {group.group for group in comparison.planted}
    left = {test: _groups(test, table, spaces[test.scenario]) for test in paired.fixes}
    shown: set[str] = set()
    chosen: list[Fix] = []
    while left and len(chosen) < limit:
        test = max(left, key=lambda test: (len(left[test] & rare - shown), len(left[test] - shown)))
        groups = left.pop(test)
        shown |= groups
        chosen.append(
            Fix(tuple(sorted(groups)), *_both(comparison, paired, (test, "fix"), table, spaces))
        )
    return chosen


def _ranked(comparison: Comparison) -> list[VersionPair]:
    """The retrained versions beside base: the champion first, then those with the fewest failures."""
    ranked = sorted(
        comparison.versions,
        key=lambda result: (result.version != comparison.champion, result.failures),
    )
    return [result.paired for result in ranked if result.paired]


def _groups(test: SequenceTest, table: pd.DataFrame, space: Space) -> set[str]:
    rows = table[(table["scenario"] == test.scenario) & (table["index"] == test.index)].head(1)
    return {
        name
        for name, members in named_groups(space, encode_tests(rows, space)).items()
        if members[0]
    }


def _both(
    comparison: Comparison,
    paired: VersionPair,
    changed: tuple[SequenceTest, str],
    table: pd.DataFrame,
    spaces: Mapping[str, Space],
) -> list[Chosen]:
    """A test with both versions. changed: the test, and which change it is."""
    (test, change), scenario = changed, changed[0].scenario
    rows = table[(table["scenario"] == scenario) & (table["index"] == test.index)].set_index(
        "version"
    )
    heading = f"{comparison.scenarios[scenario]} · {comparison.strategy} · {test.index:05d}"
    reason = f"A {change} of {paired.version} on a held-out test."
    versions = (paired.against, paired.version)
    return [
        Chosen(
            str(rows.loc[v, "test_id"]),
            scenario,
            v,
            f"{heading} · {v}",
            reason,
            concrete(rows.loc[v], spaces[scenario]),
        )
        for v in versions
    ]
