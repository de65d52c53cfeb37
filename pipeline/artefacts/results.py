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
    """Failures by failure mode; `contact + late` fail by TTC alone, `false_positives` only because Eq. 5.3 divides by them, and
    `false_activation` by braking without need."""

    contact: int = 0
    late: int = 0
    false_positives: int = 0
    false_activation: int = 0

    @property
    def by_ttc(self) -> int:
        """Failures by TTC alone."""
        return self.contact + self.late

    @property
    def total(self) -> int:
        return self.by_ttc + self.false_positives + self.false_activation


class Causes(Result):
    """Failures by cause, see `pipeline.core.causes`."""

    never_seen: int = 0
    too_late: int = 0
    box: int = 0
    confidence: int = 0
    false_positives: int = 0
    not_solvable: int = 0
    false_activation: int = 0

    @property
    def total(self) -> int:
        return sum(count for _, count in self)


class FalseActivations(Result):
    """Emergency brakings without need: `number` in `braking` of `tests` valid tests.

    duration_s: of all together. speed_loss_mps: speed lost by braking without need in these `braking` tests together.
    """

    tests: int = 0
    braking: int = 0
    number: int = 0
    duration_s: float = 0.0
    speed_loss_mps: float = 0.0

    @property
    def mean_duration_s(self) -> float | None:
        """Of a false activation; None if there is none."""
        return self.duration_s / self.number if self.number else None

    @property
    def mean_speed_loss_mps(self) -> float | None:
        """Of a test with a false activation; None if there is none."""
        return self.speed_loss_mps / self.braking if self.braking else None


class BaseRate(Result):
    """How often the first version fails in random tests of a search scenario. rate: failures per valid test, with its interval."""

    scenario: str
    version: str
    strategy: str
    tests: int
    failures: int
    rate: Estimate


class Frequencies(Result):
    """How often a base set shows children and crouching people, relative to others."""

    children: float
    crouching: float

    @property
    def uniform(self) -> bool:
        """Whether all people and poses are equally frequent; otherwise the base set is long-tailed."""
        return self.children == self.crouching == 1


class CampaignMeasures(Result):
    """Measures of one campaign; an error counts as executed, never as a failure.

    theta: cumulative failures after each test (Eq. 4.17). f_measure, f_n: tests until the first and until the n-th failure (Eq. 4.18,
    4.19), where n is the number of failures that random testing found in the budget (1 if it found none), and f_n_baseline the number of
    tests that it needed; f_measure and f_n are null if the campaign found fewer failures. c_measure: Eq. 4.20, against the baseline
    campaign of the same scenario and seed; `c_measure_assumed` if Eq. 6.2's assumption replaces the baseline's first failure; null for
    the baseline, and if the strategy did not find n failures. Coverages in [0, 1].
    """

    scenario: str
    strategy: str
    version: str
    seed: int
    tests: int
    errors: int
    failures: int
    modes: Modes
    causes: Causes
    false_activations: FalseActivations
    theta: tuple[int, ...]
    f_measure: int | None
    n: int
    f_n: int | None
    f_n_baseline: int
    c_measure: float | None
    c_measure_assumed: bool
    pair_coverage_tests: float
    pair_coverage_failures: float
    projection_coverage: float


class StrategyMeasures(Result):
    """Means over the seeds of one scenario and strategy, with Student's intervals.

    rate: failures per valid test. If the strategy draws independent samples, all tests are pooled and the interval is Wilson's; the tests
    of other strategies depend on each other, so theirs is Student's over the campaigns' rates. f_measure, c_measure: Kaplan-Meier
    estimates of the restricted mean, because a campaign without its first, or n-th, failure is right-censored at its last test;
    `f_measure_censored` and `c_measure_censored` campaigns are. See `pipeline.core.statistics.censored_mean`. c_measure is null for the
    baseline.
    """

    scenario: str
    strategy: str
    version: str
    seeds: tuple[int, ...]
    tests: int
    errors: int
    failures: int
    modes: Modes
    causes: Causes
    false_activations: FalseActivations
    rate: Estimate
    failures_per_campaign: Estimate
    f_measure: Estimate
    f_measure_censored: int
    c_measure: Estimate | None
    c_measure_censored: int
    pair_coverage_tests: Estimate
    pair_coverage_failures: Estimate
    projection_coverage: Estimate

    @property
    def base_rate(self) -> BaseRate:
        """Its failure rate as that of the base."""
        named = {"scenario": self.scenario, "version": self.version, "strategy": self.strategy}
        return BaseRate(**named, tests=self.tests - self.errors, failures=self.failures, rate=self.rate)


class Measures(Result):
    """All search campaigns measured. confidence: of every interval. k: of the projection coverage. no_braking: scenarios in which the right
    answer is not to brake."""

    confidence: float
    k: int
    baseline: str
    campaigns: tuple[CampaignMeasures, ...]
    strategies: tuple[StrategyMeasures, ...]
    no_braking: tuple[str, ...] = ()

    @property
    def base_rates(self) -> tuple[BaseRate, ...]:
        """The base failure rate of each scenario: that of the first version in tests of the baseline strategy."""
        version = self.strategies[0].version if self.strategies else ""
        return tuple(row.base_rate for row in self.strategies if (row.version, row.strategy) == (version, self.baseline))

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


class RuleCondition(Result):
    """A condition of a rule for programs. low, high: in the variable's unit, for a numeric variable; low > high wraps around the end of a
    cyclic one. values: that a categorical variable may have. text: as it stands in the rule."""

    variable: str
    text: str
    low: float | None = None
    high: float | None = None
    values: tuple[str, ...] = ()


class Inside(Result):
    """The tests inside rules: `tests`, of which `failures` fail."""

    tests: int
    failures: int

    @property
    def rate(self) -> float | None:
        """Failures per test; None without tests."""
        return self.failures / self.tests if self.tests else None


class Fresh(Result):
    """Fresh random tests. failures: of `tests` that ended well. errors: tests whose simulation broke, in neither number. rate: failures per
    test with its exact interval (Clopper-Pearson); null without tests."""

    tests: int
    failures: int
    errors: int
    rate: Estimate | None


class Confirmation(Result):
    """Fresh random tests inside and just outside a rule. confidence: of each rate's interval. p_value: chance of so many failures inside if
    both failure rates were one (Fisher's exact test, one-sided)."""

    confidence: float
    inside: Fresh
    outside: Fresh
    p_value: float


class Repair(Result):
    """A single change of a region's failures and what it repairs. change: in words. values: new values by variable. without: actors that
    are removed. repaired: failures, of `tests`, that pass with the change. errors: executions that broke, in neither number. rate: repaired
    per test with its exact interval (Clopper-Pearson); null without tests."""

    change: str
    values: dict[str, float | str]
    without: tuple[str, ...]
    tests: int
    repaired: int
    errors: int
    rate: Estimate | None


class Seen(Result):
    """What the camera saw in a region's failures. in_sight, detected: of `failures`, those in which a person could make out the pedestrian,
    and those in which the detector found the pedestrian.

    Medians; null if nothing counts. First sight: over the failures with the pedestrian in sight. First detection, and the delay from first
    sight until then: over those with both. Last chance: over those with a last frame from which full braking stops the ego in time.
    Distances are to the conflict point.
    """

    failures: int
    in_sight: int
    detected: int
    first_sight_m: float | None
    first_sight_pixels: float | None
    first_sight_contrast: float | None
    last_chance_pixels: float | None
    last_chance_contrast: float | None
    first_detection_m: float | None
    delay_s: float | None


class Why(Result):
    """Why a region's failures fail. sentence: all below in plain words. confidence: of each rate's interval. repairs: single changes, those
    that repair most first, then clear weather as a whole. control: the same with other noise alone. Without executed changes, there are no
    repairs and no control."""

    sentence: str
    seen: Seen
    confidence: float
    repairs: tuple[Repair, ...] = ()
    control: Repair | None = None


class FailureRegion(Result):
    """One group of failures with its readable rule.

    cause: why its failures failed, see `pipeline.core.causes`, or `mixed`. support: tests inside the rule; failures_inside: those that
    failed, from whatever cause; precision: their ratio. It has no interval: adaptive strategies gather their tests where failures are, and
    the rule is fitted to these tests, so they are no independent samples. lift: precision divided by the failure rate of all tests.
    recall: share of the region's members that the rule covers. held_back: tests inside rules that are fitted without these tests, each in
    turn. status: a rule is confirmed if fresh random tests inside it fail more often than those just outside; the tests that it was found
    from never confirm it. confirmation: these fresh tests, null if none were executed. why: what repairs its failures and what the camera
    saw. groups: named groups, such as `children`, to which
    every test inside the rule belongs.
    """

    name: str
    cause: str
    members: tuple[str, ...]
    modes: Modes
    strategies: dict[str, int]
    rule: str
    conditions: tuple[RuleCondition, ...]
    support: int
    failures_inside: int
    precision: float
    lift: float
    recall: float
    held_back: Inside
    status: Literal["confirmed", "not confirmed"] = "not confirmed"
    confirmation: Confirmation | None = None
    why: Why | None = None
    groups: tuple[str, ...] = ()
    representatives: tuple[Representative, ...]


class FailureRegions(Result):
    """Failure regions of one search scenario over all its campaigns; `isolated` failures are in none of them.

    connected: number of connected failure sets on the categories (Def. 4.19). not_solvable: failures that no detector could avoid with this
    camera: full braking from the first frame in which a person could see the pedestrian would have come too late.
    """

    scenario: str
    label: str
    tests: int
    failures: int
    failure_rate: float
    connected: int
    regions: tuple[FailureRegion, ...]
    isolated: tuple[str, ...]
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
