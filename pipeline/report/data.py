"""What a report shows: the artefacts of a study, read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pandas as pd

from pipeline.analysis.pair_shares import PairShare, pair_shares
from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.white_box_results import WhiteBoxMeasures
from pipeline.core.space import Space
from pipeline.report.border import Case


@dataclass(frozen=True)
class ComparedVersions:
    """The comparison, the rows of comparison.parquet and those of changes.csv."""

    comparison: Comparison
    tests: pd.DataFrame
    changes: pd.DataFrame


@dataclass(frozen=True)
class ReportData:
    """Everything that a report shows; a section whose data are None or empty is left out.

    version: the one that was searched. tests: search scenario -> rows of all its campaigns. searched: rows of the campaigns that versions
    learn from, round by round. detectors: version -> ONNX file. frames: frames.parquet of the search. filters: strategy ->
    its filter table. border: frames at the border of the filters. calibrations: of detectors that are only tested, if the study
    calibrates them. files: path -> SHA-256 of all that the page is made from.
    """

    version: str
    measures: Measures
    regions: tuple[FailureRegions, ...]
    tests: Mapping[str, pd.DataFrame]
    spaces: Mapping[str, Space]
    labels: Mapping[str, str]
    detectors: Mapping[str, Path]
    frames: Sequence[Path]
    white_box: WhiteBoxMeasures | None
    compared: ComparedVersions | None
    searched: pd.DataFrame
    filters: Mapping[str, pd.DataFrame]
    cards: tuple[ModelCard, ...]
    border: tuple[Case, ...]
    files: Mapping[str, str]
    calibrations: Mapping[str, DetectorCalibration] = field(default_factory=dict)

    @cached_property
    def pairs(self) -> Mapping[str, tuple[PairShare, ...]]:
        """What the valid tests of all strategies cover, by scenario."""
        valid = {name: tests[tests["status"] == "ok"] for name, tests in self.tests.items()}
        return {
            name: pair_shares(self.spaces[name], encode_tests(rows, self.spaces[name]), rows["failure"].to_numpy())
            for name, rows in valid.items()
        }

    @property
    def every_test(self) -> pd.DataFrame:
        """Every row of the search, of later rounds and of the comparison once."""
        held_out = [] if self.compared is None else [self.compared.tests]
        rows = pd.concat([*self.tests.values(), self.searched, *held_out], ignore_index=True)
        return rows.drop_duplicates("test_id", ignore_index=True)

    @property
    def every_label(self) -> dict[str, str]:
        """The labels of the scenarios of the search and of the comparison."""
        return {**self.labels, **({} if self.compared is None else self.compared.comparison.scenarios)}
