"""Which tests the report replays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import pandas as pd

from pipeline.artefacts.comparison_results import Comparison, VersionPair
from pipeline.artefacts.points import concrete
from pipeline.artefacts.results import FailureRegions
from pipeline.core.comparison import SequenceTest
from pipeline.core.space import Space, Value

ROLES = {"medoid": "its most typical failure", "worst": "its worst failure", "furthest": "its most unusual failure"}


@dataclass(frozen=True)
class Chosen:
    """One test to replay with one version. heading: first line on the film; reason: why it was chosen."""

    scenario: str
    version: str
    heading: str
    reason: str
    concrete: Mapping[str, Value]


def choose_regions(found: Sequence[FailureRegions], version: str, limit: int) -> list[Chosen]:
    """At most `limit` representatives: the medoids of all regions in turn of the scenarios, largest first, then the other roles."""
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
            changes = (("fixes", result.paired.fixes), ("regresses on", result.paired.regressions))
            return [test for what, tests in changes for test in _both(comparison, result.paired, what, tests[:1], table, spaces)]
    return []


def _both(
    comparison: Comparison, paired: VersionPair, what: str, tests: Sequence[SequenceTest], table: pd.DataFrame, spaces: Mapping[str, Space]
) -> list[Chosen]:
    chosen = []
    for test in tests:
        rows = table[(table["scenario"] == test.scenario) & (table["index"] == test.index)].set_index("version")
        reason = f"{paired.version} {what} this test of the held-out sequence."
        label = f"{comparison.scenarios[test.scenario]} · {comparison.strategy} · {test.index:05d}"
        chosen += [
            Chosen(test.scenario, v, f"{label} · {v}", reason, concrete(rows.loc[v], spaces[test.scenario]))
            for v in (paired.against, paired.version)
        ]
    return chosen
