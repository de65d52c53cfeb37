"""Which tests the report replays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import pandas as pd

from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.points import concrete
from pipeline.artefacts.results import FailureRegions
from pipeline.core.comparison import SequenceTest
from pipeline.core.space import Space, Value

ROLES = {"medoid": "most typical failure", "worst": "worst failure", "furthest": "most unusual failure"}


@dataclass(frozen=True)
class Chosen:
    """One test to replay with one version. heading: first line on the film; reason: why it was chosen."""

    scenario: str
    version: str
    heading: str
    reason: str
    concrete: Mapping[str, Value]


def choose_regions(found: Sequence[FailureRegions], version: str, limit: int) -> list[Chosen]:
    """At most `limit` representatives, scenarios in turn: the medoids of all regions, largest region first, then the other roles."""
    queues = []
    for regions in found:
        ranked = [(region, r) for role in ROLES for region in regions.regions for r in region.representatives if r.role == role]
        queues.append(
            [
                Chosen(
                    regions.scenario,
                    version,
                    f"{regions.label} · {r.strategy} · seed {r.seed} · {r.test_id.rsplit('-', 1)[1]}",
                    f"{region.name}, {ROLES[r.role]}: {region.rule}.",
                    r.concrete,
                )
                for region, r in ranked
            ]
        )
    return [chosen for turn in zip_longest(*queues) for chosen in turn if chosen is not None][:limit]


def choose_pairs(comparison: Comparison, table: pd.DataFrame, spaces: Mapping[str, Space]) -> list[Chosen]:
    """A fix and a regression of one retrained version, the champion if it is one, each with base and that version, in this order.

    table: rows of comparison.parquet. Empty if no version changes any outcome.
    """
    ranked = sorted((r for r in comparison.versions if r.paired), key=lambda r: (r.version != comparison.champion, r.failures))
    for result in ranked:
        assert result.paired is not None
        if result.paired.fixes or result.paired.regressions:
            fixes, regressions = result.paired.fixes[:1], result.paired.regressions[:1]
            changes = [*((test, "fix") for test in fixes), *((test, "regression") for test in regressions)]
            versions = (result.paired.against, result.version)
            return [chosen for change in changes for chosen in _both(comparison, versions, change, table, spaces)]
    return []


def _both(
    comparison: Comparison, versions: tuple[str, str], changed: tuple[SequenceTest, str], table: pd.DataFrame, spaces: Mapping[str, Space]
) -> list[Chosen]:
    """A test with both versions. changed: the test, and which change it is."""
    (test, change), scenario = changed, changed[0].scenario
    rows = table[(table["scenario"] == scenario) & (table["index"] == test.index)].set_index("version")
    heading = f"{comparison.scenarios[scenario]} · {comparison.strategy} · {test.index:05d}"
    reason = f"A {change} of {versions[1]} on a held-out test."
    return [Chosen(scenario, v, f"{heading} · {v}", reason, concrete(rows.loc[v], spaces[scenario])) for v in versions]
