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
    """One test to replay with one version.

    Attributes:
        heading: First line on the film.
        reason: Why the test was chosen.
        concrete: Variable -> value.
        region: Region that the test represents.
    """

    test_id: str
    scenario: str
    version: str
    heading: str
    reason: str
    concrete: Mapping[str, Value]
    region: str = ""


@dataclass(frozen=True)
class Fix:
    """A test that `before` fails and `after` passes. groups: its named groups."""

    groups: tuple[str, ...]
    before: Chosen
    after: Chosen


def choose_regions(scenarios: Sequence[FailureRegions], version: str, limit: int) -> list[Chosen]:
    """At most `limit` representatives of failure regions, scenarios in turn.

    The medoids of all regions come first, largest region first, then the other roles.
    """
    queues = []
    for regions in scenarios:
        queue = []
        for region in regions.regions:
            for test in region.representatives:
                number = test.test_id.rsplit("-", 1)[1]
                heading = f"{regions.label} · {test.strategy} · seed {test.seed} · {number}"
                reason = f"The {ROLES[test.role]} of {region.name}."
                identity = (test.test_id, regions.scenario, version)
                chosen = Chosen(*identity, heading, reason, test.concrete, region.name)
                queue.append((test.role, chosen))
        queue.sort(key=lambda entry: [*ROLES].index(entry[0]))
        queues.append([chosen for _, chosen in queue])
    turns = zip_longest(*queues)
    return [chosen for turn in turns for chosen in turn if chosen is not None][:limit]


def choose_regression(
    comparison: Comparison, table: pd.DataFrame, spaces: Mapping[str, Space]
) -> list[Chosen]:
    """A regression of one retrained version: the test with base, then with that version.

    The version is the champion, or the one with the fewest failures that changes any outcome.

    Args:
        comparison: The compared versions.
        table: Rows of comparison.parquet.
        spaces: Scenario -> its space.

    Returns:
        Two tests; empty without a regression.
    """
    paired = next((pair for pair in _ranked(comparison) if pair.fixes or pair.regressions), None)
    if paired is None or not paired.regressions:
        return []
    return _both(comparison, paired, paired.regressions[0], "regression", table, spaces)


def choose_fixes(
    comparison: Comparison, table: pd.DataFrame, spaces: Mapping[str, Space], limit: int
) -> list[Fix]:
    """At most `limit` fixes of one retrained version, from as many groups as possible.

    The version is the champion, or the one with the fewest failures that has any fix. Groups that
    the base set shows rarely count before other named groups; the first test in the sequence wins a
    tie.

    Args:
        comparison: The compared versions.
        table: Rows of comparison.parquet.
        spaces: Scenario -> its space.
        limit: Largest number of fixes.
    """
    paired = next((pair for pair in _ranked(comparison) if pair.fixes), None)
    if paired is None:
        return []
    rare = {group.group for group in comparison.planted}
    left = {}
    for test in paired.fixes:
        space = spaces[test.scenario]
        rows = table[(table["scenario"] == test.scenario) & (table["index"] == test.index)].head(1)
        groups = named_groups(space, encode_tests(rows, space))
        left[test] = {name for name, members in groups.items() if members[0]}
    shown: set[str] = set()
    chosen: list[Fix] = []
    while left and len(chosen) < limit:
        test = max(left, key=lambda test: (len(left[test] & rare - shown), len(left[test] - shown)))
        groups_of_test = left.pop(test)
        shown |= groups_of_test
        both = _both(comparison, paired, test, "fix", table, spaces)
        chosen.append(Fix(tuple(sorted(groups_of_test)), *both))
    return chosen


def _ranked(comparison: Comparison) -> list[VersionPair]:
    """The retrained versions beside base: the champion first, then those with fewest failures."""
    ranked = sorted(
        comparison.versions,
        key=lambda result: (result.version != comparison.champion, result.failures),
    )
    return [result.paired for result in ranked if result.paired]


def _both(
    comparison: Comparison,
    paired: VersionPair,
    test: SequenceTest,
    change: str,
    table: pd.DataFrame,
    spaces: Mapping[str, Space],
) -> list[Chosen]:
    """A test with both versions. change: `fix` or `regression`."""
    scenario = test.scenario
    same = table[(table["scenario"] == scenario) & (table["index"] == test.index)]
    rows = same.set_index("version")
    heading = f"{comparison.scenarios[scenario]} · {comparison.strategy} · {test.index:05d}"
    reason = f"A {change} of {paired.version} on a held-out test."
    both = []
    for version in (paired.against, paired.version):
        row = rows.loc[version]
        identity = (str(row["test_id"]), scenario, version)
        values = concrete(row, spaces[scenario])
        both.append(Chosen(*identity, f"{heading} · {version}", reason, values))
    return both
