"""The planted truth: people and poses that the base set shows rarely, how often their tests failed, and which regions name them."""

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
    """The searches of the base. tests: valid rows of all campaigns. spaces: by scenario. regions: of each scenario."""

    tests: pd.DataFrame
    spaces: Mapping[str, Space]
    regions: Sequence[FailureRegions]

    def of_group(self, group: str) -> pd.DataFrame:
        """The tests of a named group; none of a scenario without it."""
        parts = [self.tests[self.tests["scenario"] == name] for name in self.spaces]
        groups = [
            named_groups(space, encode_tests(rows, space))
            for rows, space in zip(parts, self.spaces.values(), strict=True)
        ]
        return pd.concat(
            [
                rows[found.get(group, np.zeros(len(rows), bool))]
                for rows, found in zip(parts, groups, strict=True)
            ]
        )

    def named(self, group: str) -> tuple[str, ...]:
        """The regions whose rules name a group."""
        return tuple(
            region.name
            for found in self.regions
            for region in found.regions
            if group in region.groups
        )


def planted_groups(
    shown: Frequencies, searched: Searched, held_out: HeldOut, named: Mapping[str, Bools]
) -> Iterator[PlantedGroup]:
    """Each group that the base was trained on rarely. shown: frequencies in its base set. named: the named groups of the held-out sequence,
    name -> (n,) bool."""
    for key, group in GROUPS.items():
        frequency = float(getattr(shown, key))
        if frequency == 1 or group not in named:
            continue
        outcomes = {
            version: held_out.outcomes(version).at(named[group]) for version in held_out.versions
        }
        yield PlantedGroup(
            group=group,
            frequency=frequency,
            searched={
                str(strategy): _count(tests)
                for strategy, tests in searched.of_group(group).groupby("strategy", sort=False)
            },
            regions=searched.named(group),
            held_out={
                version: Count(tests=found.tests, failures=found.failures)
                for version, found in outcomes.items()
            },
        )


def _count(tests: pd.DataFrame) -> Count:
    return Count(tests=len(tests), failures=int(tests["failure"].sum()))
