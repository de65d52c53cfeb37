"""The schema of params.yaml: every key with its range and meaning; an unknown key is an error that names the nearest one.

Hydra composes `conf/` into params.yaml once (`compose`); everything else reads that file (`load`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from pipeline.core.braking import Aeb, GateKind, LawKind, Vehicle
from pipeline.core.car import Car
from pipeline.core.lineage import BASE, Version, versions
from pipeline.core.matching import Criterion
from pipeline.core.names import nearest
from pipeline.core.space import Space
from pipeline.scenarios.front_car import FrontCar
from pipeline.scenarios.functional import FunctionalScenario

Seed = Annotated[int, Field(ge=0)]
Share = Annotated[float, Field(gt=0, lt=1)]


DetectorName = Annotated[str, Field(pattern=r"^[A-Za-z0-9]\w*$")]
ArmName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
BASE_SET, NEW_SCENES, BALANCED_SCENES = "base_set", "new_scenes", "balanced_scenes"
"""What an arm may learn from, beside a strategy's frames."""


def _has_target(section: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(section.get("_target_"), str) or "." not in section["_target_"]:
        raise ValueError("needs '_target_', the dotted name of a class")
    return section


Target = Annotated[dict[str, Any], AfterValidator(_has_target)]
"""Something that Hydra instantiates: `_target_` and keyword arguments of that class."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError: only keys that `declared` left out are missing."""
            if name in type(self).model_fields:
                raise AttributeError(f"'{name}' of {type(self).__name__} is read but not declared; add it to the step's sections")
            return super().__getattr__(name)


class Campaign(_Section):
    """One search campaign: a strategy, a scenario, a model version, a seed."""

    tests: int = Field(ge=1, le=100_000)
    """Test budget."""
    keep_every: int = Field(ge=0, le=1000)
    """Keep every n-th frame for retraining; 0 keeps none."""
    failure_threshold_s: float = Field(gt=0, le=10)
    """A test with an adjusted TTC at or below it is a failure (Eq. 6.1)."""
    match_iou: float = Field(ge=0.1, lt=1)
    """A detection matches the pedestrian if it overlaps the visible box by more than this IoU."""
    transfer: tuple[str, ...]
    """Strategies with campaigns that learn from those on earlier scenarios in `search`; these campaigns run one after another."""


class VehicleSection(_Section):
    """The ego's brakes."""

    dry_friction: float = Field(gt=0, le=1.5)
    """Peak friction between tyre and dry road."""
    wet_friction: float = Field(gt=0, le=1.5)
    """The same on a fully wet road, from 60 % rain; between, it falls evenly."""
    build_up_s: float = Field(ge=0, le=2)
    """Time constant of the lag between demand and deceleration; 90 % are reached after 2.3 of them."""
    latency_s: float = Field(ge=0, le=2)
    """From the exposure of a frame to the brake demand that it causes."""


class AebSection(_Section):
    """The law of the automatic emergency brake."""

    gate: GateKind
    """`truth` follows the detections that match the true pedestrian, as the thesis does; `detections` any detection in the ego's path."""
    law: LawKind
    """`confidence` brakes in proportion to the best score, as the thesis does; `threshold` brakes fully."""
    brakes_from: float | None = Field(ge=0, le=1)
    """Lowest score that brakes; null is the detector's own threshold, 0.05 is the whole range."""
    votes: int = Field(ge=1, le=20)
    """The brake acts if at least this many of the last `window` frames ask for it."""
    window: int = Field(ge=1, le=20)
    """Number of frames that vote."""
    margin_m: float = Field(ge=0, le=5)
    """Metres on each side of the ego that still belong to its path, for gate `detections`."""

    @model_validator(mode="after")
    def _can_vote(self) -> AebSection:
        if self.votes > self.window:
            raise ValueError(f"votes must be at most window, got {self.votes} of {self.window}")
        return self


class HeldOutSequence(_Section):
    """The frozen held-out sequence on which all model versions are compared."""

    tests: int = Field(ge=1, le=100_000)
    """Number of tests of the pair-wise sequence to execute."""
    strategy: str
    """The test strategy that makes the sequence; it must not learn from results."""
    seed: Seed
    """Seed of the sequences; each held-out scenario has its own sequence."""
    alpha: Share
    """Significance level of each paired test, without correction for several tests."""
    confidence: Share
    """Confidence level of all intervals and limits."""
    margin: Share
    """Highest rise of the failure rate over the base's, as a share of tests, that a champion may have in a held-out scenario or a named
    group, such as children or night. The rise's upper confidence limit must not exceed it."""
    second_iou: float | None = Field(ge=0.1, lt=1)
    """Another IoU at which held-out tests are judged again, to show whether a verdict depends on `campaign.match_iou`; null: none."""


class Rarity(_Section):
    """Frequencies of people and poses that a base set may show rarely, relative to the others; 1 shows all equally often."""

    children: float = Field(gt=0, le=1)
    """Frequency of a child relative to an adult."""
    crouching: float = Field(gt=0, le=1)
    """Frequency of the pose `crouching` relative to another."""


class BaseSet(_Section):
    """The random base training set."""

    images: int = Field(ge=10, le=1_000_000)
    """Number of images, training and validation together."""
    validation_share: float = Field(gt=0, lt=0.9)
    """Share of each town's images used for validation."""
    seed: Seed
    """Seed of towns, people, scenes and weather."""
    rare: Rarity


class Base(_Section):
    """The origin of the model version `base`."""

    source: Literal["shipped", "trained"]
    """`shipped` takes `weights`, `trained` trains from scratch on the base set."""
    weights: str
    """Folder of the shipped detector."""


class Training(_Section):
    """Training from scratch."""

    size: Literal["nano", "small"]
    """Size of the network: 1.1 or 2.6 million parameters."""
    seed: Seed
    """Seed of weights, order and augmentation."""
    batch_size: int = Field(ge=1, le=4096)
    """Images per step."""
    crop_iterations: int = Field(ge=0)
    """Batches of crops, with a quarter of a frame's pixels."""
    frame_iterations: int = Field(ge=0)
    """Batches of full frames after the crops: only full frames show near pedestrians whole."""
    learning_rate: float = Field(gt=0, lt=1)
    """The highest of the schedule."""
    oversampling: int = Field(ge=1, le=20)
    """Number of times an epoch shows an image with a pedestrian that is hard to find."""
    validate_every: int = Field(ge=1)
    """Iterations between evaluations on 500 validation images."""
    patience: int = Field(ge=1)
    """Evaluations without a better AP50 after which training stops with the best weights."""


class Retraining(_Section):
    """Retraining of the versions of all arms, with the same number of steps."""

    seeds: tuple[Seed, ...] = Field(min_length=1)
    """Seeds of the choice of frames, of order and augmentation; each makes a version of each arm."""
    searches: Literal["all", "own"]
    """`all`: each version learns from the campaigns of all `seeds` of the study; `own`: only from those of its own seed, so that versions
    of an arm differ by their search, too."""
    rounds: int = Field(ge=1, le=20)
    """Number of rounds; each repeats search, filter and retraining on the newest versions."""
    start: Literal["parent", "scratch"]
    """`parent` continues from the version before, `scratch` trains anew with section `training` on the base set and the added frames."""
    selection: Literal["all", "failures", "regions", "causes", "unsure", "missed"]
    """Kept frames to add: of `all` tests; of `failures`; of failures with equal numbers from every failure region (`regions`); of all tests
    with equal numbers of every cause and of passing tests (`causes`); of all tests, more often where the detector was `unsure` of the
    pedestrian or `missed` it."""
    batch_size: int = Field(ge=2, le=4096)
    """Images per step."""
    iterations: int = Field(ge=1)
    """Steps."""
    learning_rate: float = Field(gt=0, lt=1)
    """The highest of the schedule."""
    added_share: Share
    """Share of a batch that comes from the added frames; the rest, and all of a control's, comes from the base set."""
    added_frames: int = Field(ge=1)
    """Largest number of added frames per round; it never exceeds the number of frames of the smallest source."""
    empty_share: Share
    """Share of the added frames without a visible pedestrian; the same for all sources."""


class Filter(_Section):
    """Filter of campaign frames for training."""

    min_visible_pixels: int = Field(ge=0)
    """A pedestrian with fewer visible pixels is not a fair label."""
    min_detectability: float = Field(ge=0)
    """Contrast to the surroundings in grey levels times the square root of the visible pixels; below it a person hardly sees the
    pedestrian."""
    overrules: str | None
    """A person's CSV with test_id, step, keep."""


class Regions(_Section):
    """Failure regions."""

    chance_neighbours: float = Field(gt=0, le=10)
    """Sets the radius of the density clusters: if failures were spread evenly over the space, each would have this many neighbours
    within it."""
    min_failures: int = Field(ge=2)
    """Smallest number of failures within the radius to form a region."""


class Report(_Section):
    """The report."""

    replays: int = Field(ge=0, le=100)
    """Largest number of replay videos."""


class Tracking(_Section):
    """MLflow."""

    experiment: str
    """Name of the MLflow experiment."""
    model_name: str
    """Name of the registered model."""


class Config(_Section):
    """A study."""

    study: str = Field(pattern=r"^[a-z0-9_-]+$")
    """Name of the study; results are in data/<study>."""
    goal: Literal["report", "base", "front_car", "detectors"]
    """`report` runs the loop, `base` stops at the trained base detector, `front_car` runs the front-car study, `detectors` tests the
    detectors in `tested` and retrains none."""
    tested: dict[DetectorName, str]
    """The detectors that goal `detectors` tests, by name and file; the others are compared with the first."""
    calibrate: bool
    """Whether goal `detectors` calibrates the detectors' confidences on the validation images of the base set before it tests them."""
    seeds: tuple[Seed, ...] = Field(min_length=1)
    """Seeds of the search campaigns; with the same seed, each scenario still has its own tests."""
    search: tuple[str, ...] = Field(min_length=1)
    """Scenarios to search."""
    held_out: tuple[str, ...] = Field(min_length=1)
    """Scenarios used only for the comparison."""
    strategies: tuple[str, ...] = Field(min_length=1)
    """Test strategies of the search; the first is the baseline of the measures."""
    arms: dict[ArmName, str] = Field(min_length=1)
    """The versions that each round retrains, by name, and the source of their added frames: a strategy of the search; `base_set`, which
    adds none (a control); `new_scenes`, random scenes as in the base set, but new ones; or `balanced_scenes`, new ones in which all people
    and poses are equally frequent. The verdict compares the arm `adaptive` with every other."""
    scenarios: dict[str, FunctionalScenario]
    """The functional scenarios of both lists, from conf/scenario."""
    samplers: dict[str, Target]
    """The test strategies, from conf/sampler."""
    simulator: Target
    """The simulator that executes tests, from conf/simulator."""
    detector: Target
    """The detector under test, from conf/detector."""
    vehicle: VehicleSection
    """The ego's brakes, from conf/vehicle."""
    aeb: AebSection
    campaign: Campaign
    comparison: HeldOutSequence
    base_set: BaseSet
    base: Base
    training: Training
    retraining: Retraining
    filter: Filter
    regions: Regions
    report: Report
    tracking: Tracking
    front_car: FrontCar

    @model_validator(mode="after")
    def _names_exist(self) -> Config:
        for key in ("search", "held_out"):
            for name in getattr(self, key):
                _known(key, name, self.scenarios)
        for name in self.strategies:
            _known("strategies", name, self.samplers)
        for name in self.campaign.transfer:
            _known("campaign.transfer", name, self.strategies)
        for other in self.search[1:] if self.campaign.transfer else ():
            if self.space(other) != self.space(self.search[0]):
                raise ValueError(
                    f"campaign.transfer: {other} has another space than {self.search[0]}, but earlier campaigns need the same space"
                )
        _known("comparison.strategy", self.comparison.strategy, self.samplers)
        for arm, source in self.arms.items() if self.goal == "report" else ():
            _known(f"arms.{arm}", source, (*self.strategies, BASE_SET, NEW_SCENES, BALANCED_SCENES))
        if BASE in self.arms:
            raise ValueError(f"arms: '{BASE}' is the version before retraining; choose another name")
        for key, seeds in {"seeds": self.seeds, "retraining.seeds": self.retraining.seeds}.items():
            if len(set(seeds)) < len(seeds):
                raise ValueError(f"{key} must differ, got {list(seeds)}")
        if self.retraining.searches == "own" and self.retraining.seeds != self.seeds:
            raise ValueError(
                f"retraining.seeds must be {list(self.seeds)}, the seeds of the search, because retraining.searches is 'own', got "
                f"{list(self.retraining.seeds)}"
            )
        for name in self.samplers:
            if not re.fullmatch(r"\w+", name):
                raise ValueError(f"samplers: expected letters, digits and _ in a name, as tests are named after it, got '{name}'")
            if name in (BASE_SET, NEW_SCENES, BALANCED_SCENES):
                raise ValueError(f"samplers: '{name}' is a source of arms already; choose another name")
        if both := set(self.search) & set(self.held_out):
            raise ValueError(f"held_out must not be searched: {', '.join(sorted(both))} is in both lists")
        for unseen in self.held_out:
            first = self.held_out[0]
            if self.space(unseen) != self.space(first):
                raise ValueError(f"held_out: {unseen} has another space than {first}; scenarios of one comparison must share a space")
            for searched in self.search:
                if self.scenarios[unseen].town.fingerprint == self.scenarios[searched].town.fingerprint:
                    raise ValueError(
                        f"held_out: {unseen} has the town of {searched} (style and seed), which is searched, so training would use it"
                    )
                if (people := self.scenarios[unseen].people) is not None and people == self.scenarios[searched].people:
                    raise ValueError(
                        f"held_out: {unseen} has the people of {searched} (people: {people}), which is searched, so training would use them"
                    )
        for name in (*self.search, *self.held_out):
            if not self.scenarios[name].asks_to_brake and self.aeb.gate == "truth":
                raise ValueError(
                    f"aeb.gate: {name} asks the ego not to brake, and with 'truth' it brakes for the true pedestrian alone; set "
                    "aeb.gate=detections"
                )
        if self.goal == "detectors" and not self.tested:
            raise ValueError("tested: goal 'detectors' needs at least one detector, as in +tested.mine=best.onnx")
        if self.calibrate and self.goal != "detectors":
            raise ValueError(f"calibrate: only goal 'detectors' calibrates detectors under test, got goal '{self.goal}'")
        return self

    def earlier(self, scenario: str, strategy: str) -> tuple[str, ...]:
        """The scenarios with campaigns that a strategy's campaign on a scenario learns from."""
        if strategy not in self.campaign.transfer or scenario not in self.search:
            return ()
        return self.search[: self.search.index(scenario)]

    @property
    def sources(self) -> dict[str, str]:
        """The strategies that supply training frames, by the arm that learns from them."""
        return {arm: source for arm, source in self.arms.items() if source in self.strategies}

    @property
    def learns_from_scenes(self) -> bool:
        """Whether an arm learns from new random scenes."""
        return not {NEW_SCENES, BALANCED_SCENES}.isdisjoint(self.arms.values())

    @property
    def searched(self) -> frozenset[tuple[str, str]]:
        """Strategy and version of every search campaign, those of later rounds included."""
        later = {(self.sources[v.arm], str(v)) for version in self.versions for v in version.tested if v.arm in self.sources}
        return frozenset(later.union((strategy, "base") for strategy in self.strategies))

    @property
    def versions(self) -> tuple[Version, ...]:
        """The model versions of the study."""
        if self.goal == "detectors":
            return tuple(map(Version, self.tested))
        return versions(self.arms, self.retraining.rounds, self.retraining.seeds)

    def version(self, name: str) -> Version:
        """The version of a name, which may be a detector that the study only tests."""
        return Version(name) if name in self.tested else Version.named(name)

    def own_seeds(self, version: Version) -> tuple[int, ...]:
        """The seeds of the campaigns against a retrained version, which are also those of the campaigns that it learnt from."""
        if self.retraining.searches == "all":
            return self.seeds
        return (self.seeds[0] if version.seed is None else version.seed,)

    @property
    def threshold(self) -> float:
        """The score from which the detector reports a pedestrian; 0 if it has no threshold."""
        return float(self.detector.get("threshold", 0.0))

    @property
    def car(self) -> Car:
        """What turns the detector's report into motion."""
        aeb = self.aeb.model_dump()
        if aeb["brakes_from"] is None:
            aeb["brakes_from"] = self.threshold
        return Car(Vehicle(**self.vehicle.model_dump()), Aeb(**aeb), Criterion(self.campaign.match_iou, self.threshold))

    @property
    def unseen(self) -> dict[str, str]:
        """The held-out scenarios by the fingerprints of their towns and people, which no version may be trained on."""
        return {one: name for name in reversed(self.held_out) for _, one in self.scenarios[name].worlds}

    def space(self, scenario: str) -> Space:
        """The logical scenario space of a scenario."""
        return self.scenarios[scenario].logical_space()


def _known(key: str, name: str, known: Iterable[str]) -> None:
    if name not in known:
        raise ValueError(f"{key}: there is no '{name}'{nearest(name, known)}")


def held_out_worlds(config: Config) -> tuple[str, ...]:
    """The keys that determine which towns and people no version may be trained on."""
    return ("held_out", *(f"scenarios.{name}.{key}" for name in config.held_out for key in ("town", "people")))


JUDGED = ("detector", "vehicle", "aeb", "campaign.match_iou", "campaign.failure_threshold_s")
"""The keys that determine how a detector's report becomes motion and a KPI."""

FAN_OUT = (
    *("study", "search", "held_out", "seeds", "strategies", "arms", "retraining.rounds", "retraining.seeds", "retraining.searches"),
    *("comparison.strategy", "comparison.seed", "campaign.transfer"),
)
"""The keys that determine a study's jobs and the files that they read."""
