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

    versions: names, the base first. labels: scenario -> printed name. tables: (scenario, version) -> rows of tests.parquet by index.
    no_braking: scenarios in which the right answer is not to brake.
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
        return [
            SequenceTest(name, int(index))
            for name in self.labels
            for index in self.tables[name, base]["index"]
        ]

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
        return SequenceOutcomes(
            valid, valid & failed, valid & failed & rows["failure_mode"].isin(BY_TTC).to_numpy()
        )

    def digest(self, variables: Mapping[str, Sequence[str]]) -> str:
        """SHA-256 of the sequence. variables: scenario -> names of its variables.

        Raises InputError that names the first difference unless all versions executed the same points in the same order.
        """
        digest = hashlib.sha256()
        for scenario, names in variables.items():
            for version in self.versions:
                if (scenario, version) not in self.tables:
                    raise InputError(
                        f"expected a campaign of version '{version}' on held-out scenario '{scenario}', got none"
                    )
                _check_same(
                    self.tables[scenario, self.versions[0]], self.tables[scenario, version], names
                )
            sequence = self.tables[scenario, self.versions[0]][["index", *names]].to_csv(
                index=False, float_format="%.17g"
            )
            digest.update(f"{scenario}\n{sequence}".encode())
        return digest.hexdigest()


def read_held_out(
    paths: Sequence[Path],
    versions: Sequence[str],
    infos: Mapping[str, ScenarioInfo],
    threshold_s: float,
    progress: OnProgress,
) -> HeldOut:
    """Read tests.parquet of every scenario and version. infos: of the held-out scenarios. threshold_s: of the adjusted TTC.

    Raises InputError if a test was judged with another threshold.
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
    return HeldOut(
        tuple(versions),
        labels,
        tables,
        tuple(name for name, info in infos.items() if not info.asks_to_brake),
    )


def _check_threshold(rows: pd.DataFrame, threshold_s: float, path: Path) -> None:
    # Without a collision path, a false activation decides, and false positives alone may shorten the adjusted TTC.
    decided = np.where(
        rows["failure"], rows["failure_mode"] != "false_activation", rows["false_positives"] == 0
    )
    judged = rows[is_valid(rows) & decided]
    different = judged[judged["failure"] != (judged["adj_ttc_s"] <= threshold_s)]
    if len(different):
        row = different.iloc[0]
        raise InputError(
            f"{path}, test {row['index']}: expected a failure at an adjusted TTC of {threshold_s:g} s or below "
            f"(campaign.failure_threshold_s), got {row['adj_ttc_s']:.3g} s and failure {bool(row['failure'])}; execute it again"
        )


def _check_same(first: pd.DataFrame, other: pd.DataFrame, names: Sequence[str]) -> None:
    who = f"version '{other['version'].iloc[0]}' on scenario '{other['scenario'].iloc[0]}'"
    if len(first) != len(other):
        raise InputError(
            f"{who}: expected {len(first)} tests as version '{first['version'].iloc[0]}' has, got {len(other)}"
        )
    for name in ("strategy", "seed", "index", *names):
        different = (first[name] != other[name]).to_numpy()
        if different.any():
            row = int(different.argmax())
            expected, got = first[name].tolist()[row], other[name].tolist()[row]
            raise InputError(
                f"{who}, test {other['index'].iloc[row]}: {name} must be {expected!r} as for the base, got {got!r}"
            )
