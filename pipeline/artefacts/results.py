"""The result files of a study: measures.json, regions/<scenario>.json, comparison.json and tracking.json.

Each file is one frozen model; `read` and `write` check it, so that a truncated, foreign or older file is refused by name.
Numbers that do not exist (the F-measure of a campaign without failure) are null, never NaN.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer, ValidationError

from pipeline.artefacts.files import read_json, write_json
from pipeline.core.comparison import SequenceTest, Verdict
from pipeline.errors import InputError

Role = Literal["medoid", "worst", "furthest"]
TestName = Annotated[
    SequenceTest,
    BeforeValidator(lambda test: SequenceTest.named(test) if isinstance(test, str) else test),
    PlainSerializer(str, return_type=str),
]
"""A test of the held-out sequence, in the file by its name."""
RunKind = Literal["study", "campaign", "comparison", "model"]
ModelT = TypeVar("ModelT", bound="Result")


class Result(BaseModel):
    """Base of all result models: frozen, no unknown keys, no NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Estimate(Result):
    """A value with its confidence interval [low, high], in the value's own unit."""

    value: float
    low: float
    high: float


class Modes(Result):
    """Failures by failure mode; `contact + late` fail by TTC alone, `false_positives` only through Eq. 5.3's division."""

    contact: int = 0
    late: int = 0
    false_positives: int = 0

    @property
    def by_ttc(self) -> int:
        """Failures by TTC alone."""
        return self.contact + self.late

    @property
    def total(self) -> int:
        return self.by_ttc + self.false_positives


class CampaignMeasures(Result):
    """Measures of one campaign; an error counts as executed, never as a failure.

    theta: cumulative failures after each test (Eq. 4.17). f_measure, f_n: tests until the first and until the n-th failure
    (Eq. 4.18, 4.19), n = failures that random testing found in the budget (1 if it found none). c_measure: Eq. 4.20, against the
    baseline campaign of the same scenario and seed; `c_measure_assumed` where Eq. 6.2's assumption stood in for the baseline's
    first failure; null where the strategy did not find n failures. Coverages in [0, 1].
    """

    scenario: str
    strategy: str
    version: str
    seed: int
    tests: int
    errors: int
    failures: int
    modes: Modes
    theta: tuple[int, ...]
    f_measure: int | None
    n: int
    f_n: int | None
    c_measure: float | None
    c_measure_assumed: bool
    pair_coverage_tests: float
    pair_coverage_failures: float
    projection_coverage: float


class StrategyMeasures(Result):
    """Means over the seeds of one scenario and strategy, with Student's intervals.

    `rate` pools all tests (failures a test, Wilson). f_measure and c_measure are means over the seeds that have one,
    whose number is beside them.
    """

    scenario: str
    strategy: str
    version: str
    seeds: tuple[int, ...]
    tests: int
    errors: int
    failures: int
    modes: Modes
    rate: Estimate
    failures_per_campaign: Estimate
    f_measure: Estimate | None
    f_measure_seeds: int
    c_measure: Estimate | None
    c_measure_seeds: int
    pair_coverage_tests: Estimate
    pair_coverage_failures: Estimate
    projection_coverage: Estimate


class Measures(Result):
    """All search campaigns measured. confidence: of every interval. k: of the projection coverage."""

    confidence: float
    k: int
    baseline: str
    campaigns: tuple[CampaignMeasures, ...]
    strategies: tuple[StrategyMeasures, ...]


class Representative(Result):
    """A test that stands for a region: its medoid, its worst failure or the failure furthest from the medoid."""

    test_id: str
    role: Role
    strategy: str
    seed: int
    adj_ttc_s: float
    concrete: dict[str, float | str]


class FailureRegion(Result):
    """One group of failures with its readable rule.

    support: tests inside the rule, of which `failures_inside` failed; precision: their ratio, Wilson interval.
    recall: share of the region's members that the rule covers.
    """

    name: str
    members: tuple[str, ...]
    modes: Modes
    strategies: dict[str, int]
    rule: str
    support: int
    failures_inside: int
    precision: Estimate
    recall: float
    representatives: tuple[Representative, ...]


class FailureRegions(Result):
    """Failure regions of one search scenario over all its campaigns; `unassigned` failures lie in no dense group.

    connected: number of connected failure sets on the categories (Def. 4.19). not_solvable: failures in which full braking from the first
    frame on in which a person could see the pedestrian would have come too late: no detector could avoid them with this camera.
    """

    scenario: str
    label: str
    tests: int
    failures: int
    base_rate: float
    connected: int
    regions: tuple[FailureRegion, ...]
    unassigned: tuple[str, ...]
    not_solvable: tuple[str, ...]


class VersionPair(Result):
    """Two versions on the same tests: which of them only one fails, and the exact McNemar p-value."""

    version: str
    against: str
    tests: int
    fixes: tuple[TestName, ...]
    regressions: tuple[TestName, ...]
    p_value: float


class ScenarioResult(Result):
    """One model version on one held-out scenario; `paired` is against the base."""

    tests: int
    failures: int
    rate: Estimate
    paired: VersionPair | None


class VersionResult(Result):
    """One model version on the frozen held-out sequence.

    group: what versions that differ by the seed of retraining alone share; round: of retraining, 0 for the base. tests: valid executions.
    change: regressions minus fixes, of the tests valid for it and the base. scenarios: by scenario.
    """

    version: str
    group: str
    round: int
    tests: int
    errors: int
    failures: int
    modes: Modes
    scenarios: dict[str, ScenarioResult]
    rate: Estimate
    change: int
    paired: VersionPair | None
    verdict: Verdict


class GroupResult(Result):
    """Versions that differ by the seed of retraining alone: mean failures, in all and by scenario, with Student's intervals over the seeds;
    of a single version Wilson's over the tests.

    against_base: ratio of its mean to the base's failures; null where the base fails nowhere.
    """

    group: str
    round: int
    versions: tuple[str, ...]
    failures: Estimate
    scenarios: dict[str, Estimate]
    against_base: float | None


class GroupPair(Result):
    """Two groups on the `tests` that all of their versions executed.

    difference: mean failures of `group` minus those of `against`, with Student's interval over the seeds, paired by seed. p_value: exact
    sign-flip test of the tests' differences, summed over seeds: whether these versions differ on tests like these. With one seed it is the
    exact McNemar test.
    """

    group: str
    against: str
    tests: int
    difference: Estimate
    p_value: float

    def shown(self, alpha: float) -> bool:
        """Whether the tests tell them apart (p at most alpha) and the trainings do so, too: one seed says nothing of these, of several the
        interval must leave 0 out. By the tests alone the luck of three trainings would pass for an effect in up to a fifth of cases.
        """
        return self.p_value <= alpha and not self.difference.low <= 0 <= self.difference.high


class RegionResult(Result):
    """A failure region of the base on the held-out sequence, and how many of the tests inside its rule each version fails."""

    scenario: str
    name: str
    rule: str
    tests: int
    failures: dict[str, int]


class Comparison(Result):
    """All versions on one frozen sequence. In the file a fix or a regression is named `<scenario>-<index>`, five digits.

    pairs: exact McNemar test of every pair of versions, `against` the earlier one; group_pairs: the same for groups.
    """

    strategy: str
    scenarios: dict[str, str]
    sequence_digest: str
    confidence: float
    alpha: float
    versions: tuple[VersionResult, ...]
    groups: tuple[GroupResult, ...]
    group_pairs: tuple[GroupPair, ...]
    pairs: tuple[VersionPair, ...]
    regions: tuple[RegionResult, ...]
    champion: str
    gate: dict[str, str]

    def pair(self, version: str, against: str) -> VersionPair | None:
        """The test of a version against an earlier one; None if there are not both."""
        return next((pair for pair in self.pairs if (pair.version, pair.against) == (version, against)), None)

    def passes(self, version: str) -> bool:
        """Whether a version passed the gate; the base, which is not judged, did not."""
        return self.gate[version].startswith("passes")


class WhiteBoxSet(Result):
    """White-box coverage of one set of images, shares in [0, 1]; see `pipeline.core.coverage.whitebox`."""

    name: str
    images: int
    neuron: float
    multisection: float
    strong: float
    top: float
    pairs: float


class WhiteBoxMeasures(Result):
    """white_box.json: the base detector's neurons and what each set of images makes them do."""

    layers: int
    neurons: int
    training_images: int
    sets: tuple[WhiteBoxSet, ...]


class TrackedRun(Result):
    """One MLflow run that the study's results stand behind; its name and the digest of what was logged."""

    name: str
    kind: RunKind
    digest: str


class Tracking(Result):
    """What was tracked. Holds neither run ids nor times: the same study gives the same file on any store."""

    experiment: str
    model: str
    runs: tuple[TrackedRun, ...]
    failures: dict[str, int]
    champion: str


def write(path: Path, result: Result) -> None:
    """Write a result atomically as JSON."""
    write_json(path, result.model_dump(mode="json"))


def read(path: Path, model: type[ModelT]) -> ModelT:
    """Read a result of the given model.

    Raises InputError, naming the file and the first key that is wrong, if the file is no such result.
    """
    plain = read_json(path)
    try:
        return model.model_validate(plain)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "the file"
        raise InputError(f"{path} is not a {model.__name__} file: {key}: {first['msg']}; make it again") from error
