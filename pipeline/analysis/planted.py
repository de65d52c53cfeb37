"""The planted blind spots: people and poses that the base set shows rarely, and their failures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.analysis.held_out import HeldOut
from pipeline.analysis.named_groups import named_groups
from pipeline.artefacts.comparison_results import PlantedGroup
from pipeline.artefacts.failure_counts import Count
from pipeline.artefacts.model_card import Frequencies
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.region_results import FailureRegions
from pipeline.core.comparison import Bools
from pipeline.core.space import Space

GROUPS = {"children": "children", "crouching": "animation = crouching"}
"""Key of `base_set.rare` -> named group."""


@dataclass(frozen=True)
class Searched:
    """The searches of the base.

    Attributes:
        tests: Valid rows of all campaigns.
        spaces: Scenario -> its space.
        regions: Failure regions of each scenario.
    """

    tests: pd.DataFrame
    spaces: Mapping[str, Space]
    regions: Sequence[FailureRegions]

    def of_group(self, group: str) -> pd.DataFrame:
        """The tests of a named group; none of a scenario without it."""
        parts = []
        for name, space in self.spaces.items():
            rows = self.tests[self.tests["scenario"] == name]
            groups = named_groups(space, encode_tests(rows, space))
            parts.append(rows[groups.get(group, np.zeros(len(rows), bool))])
        return pd.concat(parts)

    def named(self, group: str) -> tuple[str, ...]:
        """The regions whose rules name a group."""
        names: list[str] = []
        for scenario in self.regions:
            names += [region.name for region in scenario.regions if group in region.groups]
        return tuple(names)


def planted_groups(
    shown: Frequencies, searched: Searched, held_out: HeldOut, named: Mapping[str, Bools]
) -> Iterator[PlantedGroup]:
    """Each group that the base set shows rarely.

    Args:
        shown: Frequencies in the base set of the base.
        searched: The searches of the base.
        held_out: The held-out tests of all versions, n each.
        named: Named groups of the held-out tests, name -> (n,) bool.
    """
    for key, group in GROUPS.items():
        frequency = float(getattr(shown, key))
        if frequency == 1 or group not in named:
            continue
        counts = {}
        for strategy, tests in searched.of_group(group).groupby("strategy", sort=False):
            failures = int(tests["failure"].sum())
            counts[str(strategy)] = Count(tests=len(tests), failures=failures)
        counts_held_out = {}
        for version in held_out.versions:
            outcomes = held_out.outcomes(version).at(named[group])
            count = Count(tests=outcomes.tests, failures=outcomes.failures)
            counts_held_out[version] = count
        yield PlantedGroup(
            group=group,
            frequency=frequency,
            searched=counts,
            regions=searched.named(group),
            held_out=counts_held_out,
        )
