"""What a report shows: the artefacts of a study, read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pandas as pd

from pipeline.analysis.pair_shares import PairShare, pair_shares
from pipeline.artefacts.calibration_results import DetectorCalibration, Diagram
from pipeline.artefacts.comparison_results import Comparison, read_changes
from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tables import is_valid, read_tests
from pipeline.artefacts.white_box_results import WhiteBoxMeasures
from pipeline.core.space import Space
from pipeline.report.border import Case


@dataclass(frozen=True)
class ComparedVersions:
    """The comparison, the rows of comparison.parquet and those of changes.csv."""

    comparison: Comparison
    tests: pd.DataFrame
    changes: pd.DataFrame

    @classmethod
    def read(cls, comparison: Path, table: Path, changes: Path) -> ComparedVersions:
        """From the three files; InputError that names the one that is truncated or of another kind."""
        return cls(read(comparison, Comparison), read_tests(table), read_changes(changes))

    @property
    def named_changes(self) -> pd.DataFrame:
        """The changes with `test_id`, the test as the version executed it."""
        return self.changes.merge(
            self.tests[["scenario", "index", "version", "test_id"]], how="left"
        )


@dataclass(frozen=True)
class ReportData:
    """Everything that a report shows; a section whose data are None or empty is left out.

    version: the one that was searched. known: search scenario -> the scenario and its space. rows: of all campaigns of the search. learnt:
    rows of the campaigns that versions learn from, round by round. detectors: version -> ONNX file. frames: frames.parquet of the search.
    filters: strategy -> its filter table. border: frames at the border of the filters. calibrations: of detectors that are only tested,
    if the study calibrates them. files: path -> SHA-256 of all that the page is made from.
    """

    version: str
    measures: Measures
    regions: tuple[FailureRegions, ...]
    known: Mapping[str, tuple[ScenarioInfo, Space]]
    rows: pd.DataFrame
    learnt: pd.DataFrame
    detectors: Mapping[str, Path]
    frames: Sequence[Path]
    files: Mapping[str, str]
    white_box: WhiteBoxMeasures | None = None
    compared: ComparedVersions | None = None
    filters: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    cards: tuple[ModelCard, ...] = ()
    border: tuple[Case, ...] = ()
    calibrations: Mapping[str, DetectorCalibration] = field(default_factory=dict)

    @property
    def reliability(self) -> Mapping[str, Mapping[str, Diagram]]:
        """Reliability diagrams by version: of the study's own calibrations, else those on the cards."""
        own = {version: found.reliability for version, found in self.calibrations.items()}
        return own or {card.version: card.reliability for card in self.cards}

    @property
    def spaces(self) -> dict[str, Space]:
        """Scenario space by search scenario."""
        return {name: space for name, (_, space) in self.known.items()}

    @property
    def labels(self) -> dict[str, str]:
        """Label by search scenario."""
        return {name: info.label for name, (info, _) in self.known.items()}

    @cached_property
    def tests(self) -> dict[str, pd.DataFrame]:
        """Rows of all campaigns by search scenario."""
        return {name: self.rows[self.rows["scenario"] == name] for name in self.known}

    @cached_property
    def pairs(self) -> Mapping[str, tuple[PairShare, ...]]:
        """What the valid tests of all strategies cover, by scenario."""
        valid = {name: tests[is_valid(tests)] for name, tests in self.tests.items()}
        return {
            name: pair_shares(
                self.spaces[name], encode_tests(rows, self.spaces[name]), rows["failure"].to_numpy()
            )
            for name, rows in valid.items()
        }

    @property
    def every_test(self) -> pd.DataFrame:
        """Every row of the search, of later rounds and of the comparison once."""
        held_out = [] if self.compared is None else [self.compared.tests]
        rows = pd.concat([*self.tests.values(), self.learnt, *held_out], ignore_index=True)
        return rows.drop_duplicates("test_id", ignore_index=True)

    @property
    def every_label(self) -> dict[str, str]:
        """The labels of the scenarios of the search and of the comparison."""
        return {
            **self.labels,
            **({} if self.compared is None else self.compared.comparison.scenarios),
        }
