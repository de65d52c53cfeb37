"""The result files of a study's search: measures.json, regions/<scenario>.json, white_box.json.

Each file is one frozen model; `read` and `write` check it, so truncated, foreign and outdated files are refused by name. Numbers that do
not exist (the F-measure of a campaign without failures) are null, never NaN.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from pipeline.artefacts.files import read_json, write_json
from pipeline.errors import InputError

Role = Literal["medoid", "worst", "furthest"]
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
    """Failures by failure mode; `contact + late` fail by TTC alone, `false_positives` only because Eq. 5.3 divides by them."""

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

    theta: cumulative failures after each test (Eq. 4.17). f_measure, f_n: tests until the first and until the n-th failure (Eq. 4.18,
    4.19), where n is the number of failures that random testing found in the budget (1 if it found none). c_measure: Eq. 4.20, against the
    baseline campaign of the same scenario and seed; `c_measure_assumed` if Eq. 6.2's assumption replaces the baseline's first failure; null
    if the strategy did not find n failures. Coverages in [0, 1].
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

    `rate` pools all tests (failures per test, Wilson). f_measure and c_measure are means over the seeds that have a value; the number of
    these seeds is beside them.
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

    def of(self, version: str) -> Measures:
        """The measures of the campaigns against one version."""
        campaigns = tuple(measured for measured in self.campaigns if measured.version == version)
        strategies = tuple(measured for measured in self.strategies if measured.version == version)
        return self.model_copy(update={"campaigns": campaigns, "strategies": strategies})


class Representative(Result):
    """A test that represents a region: its medoid, its worst failure or the failure furthest from the medoid."""

    test_id: str
    role: Role
    strategy: str
    seed: int
    adj_ttc_s: float
    concrete: dict[str, float | str]


class FailureRegion(Result):
    """One group of failures with its readable rule.

    support: tests inside the rule; failures_inside: those that failed; precision: their ratio, Wilson interval. recall: share of the
    region's members that the rule covers.
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
    """Failure regions of one search scenario over all its campaigns; `unassigned` failures belong to no dense group.

    connected: number of connected failure sets on the categories (Def. 4.19). not_solvable: failures that no detector could avoid with this
    camera: full braking from the first frame in which a person could see the pedestrian would have come too late.
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
    """white_box.json: the base detector's neurons and how each set of images activates them."""

    layers: int
    neurons: int
    training_images: int
    sets: tuple[WhiteBoxSet, ...]


def write(path: Path, result: Result) -> None:
    """Write a result atomically as JSON."""
    write_json(path, result.model_dump(mode="json"))


def read(path: Path, model: type[ModelT]) -> ModelT:
    """Read a result of the given model.

    Raises InputError that names the file and the first wrong key if the file is not such a result.
    """
    plain = read_json(path)
    try:
        return model.model_validate(plain)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "the file"
        raise InputError(f"{path} is not a {model.__name__} file: {key}: {first['msg']}; make it again") from error
