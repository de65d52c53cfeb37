"""The held-out sequence, as every model version executed it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.artefacts.tables import campaign_of, is_valid, read_tests
from pipeline.core.comparison import Bools, SequenceOutcomes, SequenceTest
from pipeline.errors import InputError
from pipeline.progress import OnProgress

BY_TTC = ("contact", "late")
"""Failure modes by TTC alone."""


@dataclass(frozen=True)
class HeldOut:
    """The tests of all versions on all held-out scenarios.

    Attributes:
        versions: Names, the base first.
        labels: Scenario -> printed name.
        tables: (scenario, version) -> rows of tests.parquet by index.
        no_braking: Scenarios in which the right answer is not to brake.
    """

    versions: Sequence[str]
    labels: Mapping[str, str]
    tables: Mapping[tuple[str, str], pd.DataFrame]
    no_braking: tuple[str, ...] = ()

    @cached_property
    def joined(self) -> pd.DataFrame:
        """All rows: scenario by scenario, and version by version in each."""
        return pd.concat(
            [self.tables[name, version] for name in self.labels for version in self.versions],
            ignore_index=True,
        )

    @cached_property
    def tests(self) -> list[SequenceTest]:
        """The tests of the sequence in its order, scenario by scenario."""
        base = self.versions[0]
        tests = []
        for name in self.labels:
            tests += [SequenceTest(name, int(index)) for index in self.tables[name, base]["index"]]
        return tests

    @cached_property
    def scenarios(self) -> dict[str, Bools]:
        """Scenario -> (n,) bool, the tests of the sequence that belong to it."""
        names = np.array([test.scenario for test in self.tests])
        return {name: names == name for name in self.labels}

    def rows(self, version: str) -> pd.DataFrame:
        """The rows of one version in the order of the sequence."""
        return pd.concat([self.tables[name, version] for name in self.labels], ignore_index=True)

    def outcomes(self, version: str) -> SequenceOutcomes:
        """The outcomes of one version on the sequence."""
        rows = self.rows(version)
        valid, failed = is_valid(rows).to_numpy(), rows["failure"].to_numpy(bool)
        by_ttc = rows["failure_mode"].isin(BY_TTC).to_numpy()
        return SequenceOutcomes(valid, valid & failed, valid & failed & by_ttc)

    def digest(self, variables: Mapping[str, Sequence[str]]) -> str:
        """SHA-256 of the sequence.

        Args:
            variables: Scenario -> names of its variables.

        Raises:
            InputError: Not all versions executed the same points in the same order; the message
                names the first difference.
        """
        digest = hashlib.sha256()
        for scenario, names in variables.items():
            for version in self.versions:
                if (scenario, version) not in self.tables:
                    raise InputError(
                        f"expected a campaign of version '{version}' on held-out scenario "
                        f"'{scenario}', got none"
                    )
                first, other = (self.tables[scenario, v] for v in (self.versions[0], version))
                _check_same(first, other, names)
            points = self.tables[scenario, self.versions[0]][["index", *names]]
            sequence = points.to_csv(index=False, float_format="%.17g")
            digest.update(f"{scenario}\n{sequence}".encode())
        return digest.hexdigest()


def read_held_out(
    paths: Sequence[Path],
    versions: Sequence[str],
    infos: Mapping[str, ScenarioInfo],
    threshold_s: float,
    progress: OnProgress,
) -> HeldOut:
    """Read tests.parquet of every scenario and version.

    Args:
        paths: The files.
        versions: Names of the versions, the base first.
        infos: The held-out scenarios by name.
        threshold_s: Adj. TTC at or below which a test fails.
        progress: Called after each file.

    Raises:
        InputError: A test was judged with another threshold.
    """
    tables = {}
    for done, path in enumerate(paths, 1):
        rows = read_tests(path).sort_values("index", ignore_index=True)
        campaign = campaign_of(rows, path)
        if infos[campaign.scenario].asks_to_brake:
            _check_threshold(rows, threshold_s, path)
        tables[campaign.scenario, campaign.version] = rows
        progress(done, len(paths), f"{campaign.scenario}/{campaign.version}")
    labels = {name: info.label for name, info in infos.items()}
    no_braking = tuple(name for name, info in infos.items() if not info.asks_to_brake)
    return HeldOut(tuple(versions), labels, tables, no_braking)


def _check_threshold(rows: pd.DataFrame, threshold_s: float, path: Path) -> None:
    """InputError if the adj. TTC of a test contradicts its outcome."""
    # Without a collision path, a false activation decides; false positives alone may shorten the
    # adj. TTC.
    activated = rows["failure_mode"] == "false_activation"
    decided = np.where(rows["failure"], ~activated, rows["false_positives"] == 0)
    judged = rows[is_valid(rows) & decided]
    different = judged[judged["failure"] != (judged["adj_ttc_s"] <= threshold_s)]
    if len(different):
        row = different.iloc[0]
        raise InputError(
            f"{path}, test {row['index']}: expected a failure at an adjusted TTC of "
            f"{threshold_s:g} s or below (campaign.failure_threshold_s), got "
            f"{row['adj_ttc_s']:.3g} s and failure {bool(row['failure'])}; execute it again"
        )


def _check_same(first: pd.DataFrame, other: pd.DataFrame, names: Sequence[str]) -> None:
    """InputError if two versions executed different points on a scenario."""
    who = f"version '{other['version'].iloc[0]}' on scenario '{other['scenario'].iloc[0]}'"
    if len(first) != len(other):
        raise InputError(
            f"{who}: expected {len(first)} tests as version '{first['version'].iloc[0]}' has, got "
            f"{len(other)}"
        )
    for name in ("strategy", "seed", "index", *names):
        different = (first[name] != other[name]).to_numpy()
        if different.any():
            row = int(different.argmax())
            expected, got = first[name].tolist()[row], other[name].tolist()[row]
            raise InputError(
                f"{who}, test {other['index'].iloc[row]}: {name} must be {expected!r} as for the "
                f"base, got {got!r}"
            )
