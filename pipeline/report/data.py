"""The contents of a report: the artefacts of a study."""

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
        """From the three files.

        Raises:
            InputError: A file is truncated or of another kind; the message names it.
        """
        return cls(read(comparison, Comparison), read_tests(table), read_changes(changes))

    @property
    def named_changes(self) -> pd.DataFrame:
        """The changes with `test_id`, the test as the version executed it."""
        return self.changes.merge(
            self.tests[["scenario", "index", "version", "test_id"]], how="left"
        )


@dataclass(frozen=True)
class ReportData:
    """The contents of a report; a section without data is left out.

    Attributes:
        version: The searched version.
        measures: Measures of all campaigns and strategies.
        regions: Failure regions of each search scenario.
        scenarios: Search scenario -> the scenario and its space.
        rows: Rows of all campaigns of the search.
        learnt: Rows of the campaigns that versions learn from, round by round.
        detectors: Version -> ONNX file.
        frames: frames.parquet of the search.
        files: Path -> SHA-256 of each file that the page is made from.
        white_box: Coverage of the detector's neurons.
        compared: The comparison of versions.
        filters: Strategy -> its filter table.
        cards: Model cards of the versions.
        border: Frames near the thresholds of the filter.
        calibrations: Version -> its calibration, of detectors that are only tested.
    """

    version: str
    measures: Measures
    regions: tuple[FailureRegions, ...]
    scenarios: Mapping[str, tuple[ScenarioInfo, Space]]
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
        """Reliability diagrams by version: from the calibrations, or else from the cards."""
        if self.calibrations:
            return {version: fitted.reliability for version, fitted in self.calibrations.items()}
        return {card.version: card.reliability for card in self.cards}

    @property
    def spaces(self) -> dict[str, Space]:
        """Scenario space by search scenario."""
        return {name: space for name, (_, space) in self.scenarios.items()}

    @property
    def labels(self) -> dict[str, str]:
        """Label by search scenario."""
        return {name: info.label for name, (info, _) in self.scenarios.items()}

    @cached_property
    def tests(self) -> dict[str, pd.DataFrame]:
        """Rows of all campaigns by search scenario."""
        return {name: self.rows[self.rows["scenario"] == name] for name in self.scenarios}

    @cached_property
    def pairs(self) -> Mapping[str, tuple[PairShare, ...]]:
        """Pairs of categories that the valid tests of all strategies cover, by scenario."""
        shares = {}
        for name, tests in self.tests.items():
            rows, space = tests[is_valid(tests)], self.spaces[name]
            points, failed = encode_tests(rows, space), rows["failure"].to_numpy()
            shares[name] = pair_shares(space, points, failed)
        return shares

    @property
    def every_test(self) -> pd.DataFrame:
        """Every row of the search, of later rounds and of the comparison once."""
        held_out = [] if self.compared is None else [self.compared.tests]
        rows = pd.concat([*self.tests.values(), self.learnt, *held_out], ignore_index=True)
        return rows.drop_duplicates("test_id", ignore_index=True)

    @property
    def every_label(self) -> dict[str, str]:
        """The labels of the scenarios of the search and of the comparison."""
        if self.compared is None:
            return self.labels
        return {**self.labels, **self.compared.comparison.scenarios}
