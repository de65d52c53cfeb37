"""comparison.json and changes.csv: every model version on the same frozen sequence of held-out
tests.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Annotated

import pandas as pd
from pydantic import BeforeValidator, PlainSerializer

from pipeline.artefacts.failure_counts import Causes, Count, FalseActivations, Modes
from pipeline.artefacts.files import read_bytes, write_bytes
from pipeline.artefacts.model_card import Frequencies
from pipeline.artefacts.results import Estimate, Result
from pipeline.artefacts.search_results import BaseRate
from pipeline.core.comparison import SequenceTest, Verdict, judge
from pipeline.core.gate import Judgement, Measure
from pipeline.errors import InputError

TestName = Annotated[
    SequenceTest,
    BeforeValidator(lambda test: SequenceTest.named(test) if isinstance(test, str) else test),
    PlainSerializer(str, return_type=str),
]
"""A test of the held-out sequence; the file stores its name."""


class VersionPair(Result):
    """Two versions on the same tests.

    It has the tests that only one of them fails, and the exact McNemar p-value.
    """

    version: str
    against: str
    tests: int
    fixes: tuple[TestName, ...]
    regressions: tuple[TestName, ...]
    p_value: float

    def verdict(self, alpha: float) -> Verdict:
        """See `pipeline.core.comparison.judge`."""
        return judge(len(self.fixes), len(self.regressions), self.p_value, alpha)


class ScenarioResult(Result):
    """One model version on one held-out scenario.

    Attributes:
        rate: failures per valid test.
        paired: against the base.
    """

    tests: int
    failures: int
    rate: float
    false_activations: FalseActivations
    paired: VersionPair | None


class LimitResult(Result):
    """How far a version's failure rate may be above the base's on the `tests` of a scenario or of a
    named group that are valid for both.

    Attributes:
        name: printed name of the scenario, or name of the group.
        measure: false activations are the failures of tests that ask not to brake.
        p_value: of the exact McNemar test, not corrected for the number of parts.
        limit: one-sided upper confidence limit of the rise (Tango 1998), as a share of tests.
        judgement: of the rise, with the corrected p-value and the comparison's margin; a part that
            is too small to judge does not hold the version back. See `pipeline.core.gate`.
    """

    name: str
    measure: Measure
    tests: int
    fixes: int
    regressions: int
    p_value: float
    limit: float
    judgement: Judgement


class VersionResult(Result):
    """One model version on the frozen held-out sequence.

    Attributes:
        group: name shared by versions that differ only by the seed of retraining.
        round: of retraining, 0 for the base.
        tests: valid executions.
        rate: failures per valid test.
        change: regressions minus fixes, over the tests that are valid for this version and the
            base.
        scenarios: results by scenario.
        limits: of the rise in each scenario and named group; none for the base.
    """

    version: str
    group: str
    round: int
    tests: int
    errors: int
    failures: int
    modes: Modes
    causes: Causes
    scenarios: dict[str, ScenarioResult]
    rate: float
    change: int
    paired: VersionPair | None
    verdict: Verdict
    limits: tuple[LimitResult, ...]


class GroupResult(Result):
    """Versions that differ only by the seed of retraining.

    It has mean failures, in total and by scenario, with Student's intervals over the seeds, on the
    `tests` that are valid for every version of the study.

    A single version has no interval (low = high), see
    `pipeline.core.comparison.SequenceOutcomes.rate`.

    Attributes:
        against_base: ratio of its mean to the base's failures; null if the base never fails.
    """

    group: str
    round: int
    versions: tuple[str, ...]
    tests: int
    failures: Estimate
    scenarios: dict[str, Estimate]
    against_base: float | None


class GroupPair(Result):
    """Two groups on the `tests` that are valid for all of their versions.

    Attributes:
        difference: mean failures of `group` minus those of `against`, with Student's interval over
            the seeds, paired by seed.
        p_value: exact randomisation test over the tests: whether these versions differ on tests
            like these. With one seed it equals the exact McNemar test.
    """

    group: str
    against: str
    tests: int
    difference: Estimate
    p_value: float

    def shown(self, alpha: float) -> bool:
        """Whether the tests show a difference (p at most alpha) and, with several seeds, the
        interval over the seeds excludes 0.

        One seed says nothing about the variation between trainings. Judged by the tests alone, the
        variation of three trainings would pass for an effect in up to a fifth of cases.
        """
        return self.p_value <= alpha and not self.difference.low <= 0 <= self.difference.high

    def shows_fewer(self, alpha: float) -> bool:
        """Whether a difference is shown, and `group` has fewer failures than `against`."""
        return self.shown(alpha) and self.difference.value < 0


class SecondIou(Result):
    """The groups and their pairs on the same tests, judged and, where the brake would have acted
    otherwise, driven with another IoU.

    Attributes:
        iou: at which detections match here.
        first: in the comparison itself.
    """

    iou: float
    first: float
    groups: tuple[GroupResult, ...]
    group_pairs: tuple[GroupPair, ...]


class RegionResult(Result):
    """A failure region of the base on the held-out sequence, and each version's failures among the
    `tests` inside its rule that are valid for every version.
    """

    scenario: str
    name: str
    rule: str
    tests: int
    failures: dict[str, int]


class PlantedGroup(Result):
    """A group of people or poses that the base was trained on rarely.

    Attributes:
        group: its name.
        frequency: relative to others, in (0, 1).
        searched: strategy -> its tests of the group.
        regions: the base's regions with rules that name the group.
        held_out: version -> the held-out tests of the group.
    """

    group: str
    frequency: float
    searched: dict[str, Count]
    regions: tuple[str, ...]
    held_out: dict[str, Count]


class Comparison(Result):
    """All versions on one frozen sequence.

    The file names a fix or a regression `<scenario>-<index>`, with five digits.

    Attributes:
        pairs: exact McNemar test of every pair of versions, `against` is the earlier one.
        group_pairs: every pair of groups.
        no_braking: held-out scenarios in which the right answer is not to brake.
        base_rates: of the search scenarios.
        trained_on: the base set that the base was trained on; null if its card does not say.
        base_set: the base set of this study; null for one that only tests detectors.
        second: null if the study asks for no second IoU.
        margin: highest rise of a failure rate over the base's that the gate tolerates, as a share
            of tests.
        gate: of each version, why the gate passes it or holds it back.
        passing: the versions that pass.
        planted: the groups that the base was trained on rarely.
    """

    strategy: str
    scenarios: dict[str, str]
    sequence_digest: str
    confidence: float
    alpha: float
    margin: float
    versions: tuple[VersionResult, ...]
    groups: tuple[GroupResult, ...]
    group_pairs: tuple[GroupPair, ...]
    pairs: tuple[VersionPair, ...]
    regions: tuple[RegionResult, ...]
    champion: str
    gate: dict[str, str]
    passing: tuple[str, ...]
    no_braking: tuple[str, ...] = ()
    base_rates: tuple[BaseRate, ...] = ()
    trained_on: Frequencies | None = None
    base_set: Frequencies | None = None
    second: SecondIou | None = None
    planted: tuple[PlantedGroup, ...] = ()

    def pair(self, version: str, against: str) -> VersionPair | None:
        """The comparison of a version with an earlier one; None if either is missing."""
        return next(
            (pair for pair in self.pairs if (pair.version, pair.against) == (version, against)),
            None,
        )

    @property
    def seeds(self) -> int:
        """Number of seeds of retraining."""
        return max(len(group.versions) for group in self.groups)

    def passes(self, version: str) -> bool:
        """Whether a version passed the gate; False for the base, which the gate does not judge."""
        return version in self.passing


def write_changes(path: Path, changes: pd.DataFrame) -> None:
    """Write the tests that a version changed."""
    write_bytes(
        path, changes.to_csv(index=False, lineterminator="\n", float_format="%.6g").encode()
    )


def read_changes(path: Path) -> pd.DataFrame:
    """Read changes.csv; InputError that names the file if it is missing, damaged or no table."""
    data = read_bytes(path)
    try:
        return pd.read_csv(
            io.BytesIO(data), keep_default_na=False, na_values=[""]
        )  # A version may be called "null".
    except ValueError as error:
        raise InputError(f"{path}: expected a table, got {error}; make it again") from error
