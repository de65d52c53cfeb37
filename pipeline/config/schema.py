"""The schema of params.yaml, a study; an unknown key is an error that names the nearest one.

Hydra composes `conf/` into params.yaml once (`compose`); everything else reads that file (`load`).
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from operator import attrgetter
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from pipeline.config.exposure import ExposureFile
from pipeline.config.sections import (
    AebSection,
    Base,
    BaseSet,
    Campaign,
    Filter,
    HeldOutSequence,
    Limits,
    Plain,
    Regions,
    Report,
    Retraining,
    Section,
    Title,
    Tracking,
    Training,
    VehicleSection,
)
from pipeline.config.targets import named
from pipeline.core.braking import EMERGENCY_MPS2, GRAVITY_MPS2, Aeb, Vehicle
from pipeline.core.car import Car
from pipeline.core.lineage import BASE, Version, versions
from pipeline.core.matching import Criterion
from pipeline.core.names import nearest
from pipeline.core.space import Space
from pipeline.errors import shown
from pipeline.scenarios.front_car import FrontCar
from pipeline.scenarios.functional import FunctionalScenario
from pipeline.scenarios.parts import Name, Seed

BASE_SET, NEW_SCENES, BALANCED_SCENES = "base_set", "new_scenes", "balanced_scenes"
"""What an arm may learn from, beside a strategy's frames."""
AUDIT = "random"
"""The strategy of the audit, see `Campaign.audit`."""


def _has_target(section: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(section.get("_target_"), str) or "." not in section["_target_"]:
        raise ValueError("needs '_target_', the dotted name of a class")
    return section


Target = Annotated[dict[str, Any], AfterValidator(_has_target)]
"""Something that Hydra instantiates: `_target_` and keyword arguments of that class."""


class Config(Section):
    """A study."""

    study: Title
    """Name of the study; results are in data/<study>."""
    goal: Literal["report", "base", "front_car", "detectors"]
    """`report` runs the loop, `base` stops at the trained base detector, `front_car` runs the
    front-car study, `detectors` tests the detectors in `tested` and retrains none."""
    tested: dict[Name, Plain]
    """The detectors that goal `detectors` tests, by name and file; the others are compared with the
    first."""
    calibrate: bool
    """Whether goal `detectors` calibrates the detectors' confidences on the validation images of
    the base set before it tests them."""
    seeds: tuple[Seed, ...] = Field(min_length=1)
    """Seeds of the search campaigns; with the same seed, each scenario still has its own tests."""
    search: tuple[str, ...] = Field(min_length=1)
    """Scenarios to search."""
    held_out: tuple[str, ...] = Field(min_length=1)
    """Scenarios used only for the comparison."""
    strategies: tuple[str, ...] = Field(min_length=1)
    """Test strategies of the search; the first is the baseline of the measures."""
    arms: dict[Name, str] = Field(min_length=1)
    """The versions that each round retrains, by name, and the source of their added frames: a
    strategy of the search; `base_set`, which adds none (a control); `new_scenes`, random scenes as
    in the base set, but new ones; or `balanced_scenes`, new ones in which all people and poses are
    equally frequent. The verdict compares the arm `adaptive` with every other."""
    scenarios: dict[Name, FunctionalScenario]
    """The functional scenarios of both lists, from conf/scenario."""
    samplers: dict[Name, Target]
    """The test strategies, from conf/sampler."""
    simulator: Target
    """The simulator that executes tests, from conf/simulator."""
    detector: Target
    """The detector under test, from conf/detector."""
    vehicle: VehicleSection
    """The ego's brakes, from conf/vehicle."""
    aeb: AebSection
    exposure: ExposureFile
    """How often conditions occur, from conf/exposure: what the evidence's shares are shares of."""
    campaign: Campaign
    limits: Limits
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
    def _names_fit(self) -> Config:
        for key in ("search", "held_out"):
            for name in getattr(self, key):
                _check_exists(key, name, self.scenarios)
        for name in self.strategies:
            _check_exists("strategies", name, self.samplers)
        for name in self.campaign.transfer:
            _check_exists("campaign.transfer", name, self.strategies)
        _check_exists("comparison.strategy", self.comparison.strategy, self.samplers)
        sources = (*self.strategies, BASE_SET, NEW_SCENES, BALANCED_SCENES)
        for arm, source in self.arms.items() if self.goal == "report" else ():
            if source not in sources:
                raise ValueError(
                    f"arms.{arm}: '{source}' is not in strategies, so it supplies no frames; add "
                    f"it to strategies, set arms.{arm} to another source, or remove the arm with "
                    f"~arms.{arm}{nearest(source, sources)}"
                )
        if BASE in self.arms:
            raise ValueError(
                f"arms: '{BASE}' is the version before retraining; choose another name"
            )
        for name in self.samplers:
            if name in (BASE_SET, NEW_SCENES, BALANCED_SCENES):
                raise ValueError(
                    f"samplers: '{name}' is a source of arms already; choose another name"
                )
        return self

    @model_validator(mode="after")
    def _entries_differ(self) -> Config:
        # Tests would count twice, as if they were independent.
        for key in (
            "search",
            "held_out",
            "strategies",
            "seeds",
            "retraining.seeds",
            "campaign.transfer",
        ):
            entries = attrgetter(key)(self)
            for entry in entries:
                if entries.count(entry) > 1:
                    raise ValueError(f"{key}: expected different entries, got {shown(entry)} twice")
        by_label: dict[str, str] = {}
        for name in (*self.search, *self.held_out):
            label = self.scenarios[name].label
            if (other := by_label.setdefault(label, name)) != name:
                raise ValueError(
                    f"scenarios.{name}.label: {other} has the label {shown(label)}, too; "
                    "choose another"
                )
        return self

    @model_validator(mode="after")
    def _parts_agree(self) -> Config:
        if self.retraining.searches == "own" and self.retraining.seeds != self.seeds:
            raise ValueError(
                f"retraining.seeds must be {list(self.seeds)}, the seeds of the search, "
                f"because retraining.searches is 'own', got {list(self.retraining.seeds)}"
            )
        for other in self.search[1:] if self.campaign.transfer else ():
            if self.space(other) != self.space(self.search[0]):
                raise ValueError(
                    f"campaign.transfer: {other} and {self.search[0]} have different spaces; "
                    "campaigns that transfer must share one"
                )
        for unseen in self.held_out[1:]:
            first = self.held_out[0]
            if self.space(unseen) != self.space(first):
                raise ValueError(
                    f"held_out: {unseen} and {first} have different spaces; "
                    "scenarios of one comparison must share one"
                )
        return self

    @model_validator(mode="after")
    def _held_out_is_unseen(self) -> Config:
        if both := set(self.search) & set(self.held_out):
            raise ValueError(
                f"held_out must not be searched, but both lists have {', '.join(sorted(both))}"
            )
        for unseen, searched in product(self.held_out, self.search):
            ours, theirs = self.scenarios[unseen], self.scenarios[searched]
            if ours.town.fingerprint == theirs.town.fingerprint:
                raise ValueError(
                    f"held_out: {unseen} has the town of {searched} (style and seed), "
                    "which is searched, so training would use it"
                )
            if ours.people is not None and ours.people == theirs.people:
                raise ValueError(
                    f"held_out: {unseen} has the people of {searched} (people: {ours.people}), "
                    "which is searched, so training would use them"
                )
        return self

    @model_validator(mode="after")
    def _can_brake_without_need(self) -> Config:
        for name in (*self.search, *self.held_out):
            if self.scenarios[name].asks_to_brake:
                continue
            if self.aeb.gate == "truth":
                raise ValueError(
                    f"aeb.gate: {name} asks the ego not to brake, and with 'truth' it brakes for "
                    "the true pedestrian alone; set aeb.gate=detections"
                )
            if self.car.vehicle.full_brake_mps2(rain=0) < EMERGENCY_MPS2:
                raise ValueError(
                    f"vehicle.dry_friction: {name} asks the ego not to brake, and fails from a "
                    f"demand of {EMERGENCY_MPS2:g} m/s², which needs a friction of "
                    f"{EMERGENCY_MPS2 / GRAVITY_MPS2:.2f}, got {self.vehicle.dry_friction}"
                )
        return self

    @model_validator(mode="after")
    def _brakes_for_what_is_judged(self) -> Config:
        lowest = self.aeb.brakes_from
        if lowest is None or lowest >= self.threshold or self.aeb.why_below_threshold:
            return self
        raise ValueError(
            f"aeb.brakes_from: boxes brake from a score of {lowest:g} and are false positives from "
            f"detector.threshold={self.threshold:g}; in the thesis both are one threshold: say in "
            "aeb.why_below_threshold why they differ"
        )

    @model_validator(mode="after")
    def _goal_fits(self) -> Config:
        if self.goal == "detectors" and not self.tested:
            raise ValueError(
                "tested: goal 'detectors' needs at least one detector, as in +tested.mine=best.onnx"
            )
        if self.calibrate and self.goal != "detectors":
            raise ValueError(
                "calibrate: only goal 'detectors' calibrates detectors under test, "
                f"got goal '{self.goal}'"
            )
        return self

    def earlier(self, scenario: str, strategy: str) -> tuple[str, ...]:
        """The scenarios with campaigns that a strategy's campaign on a scenario learns from."""
        if strategy not in self.campaign.transfer or scenario not in self.search:
            return ()
        return self.search[: self.search.index(scenario)]

    def learns(self, strategy: str) -> bool:
        """Whether a strategy's tests depend on results: `learns` of its class, true by default."""
        return bool(getattr(self._class(strategy), "learns", True))

    def independent(self, strategy: str) -> bool:
        """Whether a strategy's tests are independent samples: `independent` of its class."""
        return bool(getattr(self._class(strategy), "independent", False))

    def _class(self, strategy: str) -> Any:
        return named(f"samplers.{strategy}._target_", self.samplers[strategy]["_target_"])

    @property
    def audited(self) -> bool:
        """Whether an audit is executed.

        The study asks for it, and no strategy of the search has independent tests anyhow.
        """
        return self.campaign.audit > 0 and not any(map(self.independent, self.strategies))

    @property
    def sources(self) -> dict[str, str]:
        """The strategies that supply training frames, by the arm that learns from them."""
        return {arm: source for arm, source in self.arms.items() if source in self.strategies}

    @property
    def learns_from_scenes(self) -> bool:
        """Whether an arm learns from new random scenes."""
        return not {NEW_SCENES, BALANCED_SCENES}.isdisjoint(self.arms.values())

    @property
    def later(self) -> dict[str, str]:
        """The retrained versions that later rounds search, each with the strategy of its arm."""
        sources = self.sources
        later = {}
        for version in self.versions:
            for tested in version.tested:
                if tested.arm in sources:
                    later[str(tested)] = sources[tested.arm]
        return later

    @property
    def searched(self) -> frozenset[tuple[str, str]]:
        """Strategy and version of every search campaign, those of later rounds included."""
        later = {(strategy, version) for version, strategy in self.later.items()}
        return frozenset(later.union((strategy, "base") for strategy in self.strategies))

    @property
    def versions(self) -> tuple[Version, ...]:
        """The model versions of the study."""
        if self.goal == "detectors":
            return tuple(map(Version, self.tested))
        return versions(self.arms, self.retraining.rounds, self.retraining.seeds)

    @property
    def wildcards(self) -> dict[str, list[str]]:
        """The names that a job may have as its scenario, strategy, version and seed.

        `base` is a version in every study.
        """
        versions = dict.fromkeys([BASE, *map(str, self.versions)])
        seeds = dict.fromkeys(map(str, (*self.seeds, *self.retraining.seeds, self.comparison.seed)))
        return {
            "scenario": list(self.scenarios),
            "strategy": list(self.samplers),
            "version": list(versions),
            "seed": list(seeds),
        }

    def version(self, name: str) -> Version:
        """The version of a name, which may be a detector that the study only tests."""
        return Version(name) if name in self.tested else Version.named(name)

    def own_seeds(self, version: Version) -> tuple[int, ...]:
        """Seeds of the campaigns against a retrained version, and of those that it learnt from."""
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
        aeb = self.aeb.model_dump(exclude={"why_below_threshold"})
        if aeb["brakes_from"] is None:
            aeb["brakes_from"] = self.threshold
        return Car(
            Vehicle(**self.vehicle.model_dump()),
            Aeb(**aeb),
            Criterion(self.campaign.match_iou, self.threshold),
        )

    @property
    def camera(self) -> dict[str, Any]:
        """The settings of the simulator's camera; empty if it has none."""
        settings: dict[str, Any] = self.simulator.get("camera", {})
        return settings

    @property
    def unseen(self) -> dict[str, str]:
        """The held-out scenarios by the fingerprints of their towns and people.

        No version may be trained on these.
        """
        unseen = {}
        for name in reversed(self.held_out):
            for _, fingerprint in self.scenarios[name].worlds:
                unseen[fingerprint] = name
        return unseen

    def space(self, scenario: str) -> Space:
        """The logical scenario space of a scenario."""
        return self.scenarios[scenario].logical_space()


def _check_exists(key: str, name: str, names: Iterable[str]) -> None:
    if name not in names:
        raise ValueError(f"{key}: there is no '{name}'{nearest(name, names)}")


def held_out_worlds(config: Config) -> tuple[str, ...]:
    """The keys that determine which towns and people no version may be trained on."""
    worlds = product(config.held_out, ("town", "people"))
    return "held_out", *(f"scenarios.{name}.{key}" for name, key in worlds)


JUDGED = ("detector", "vehicle", "aeb", "campaign.match_iou", "campaign.failure_threshold_s")
"""The keys that determine how a detector's report becomes motion and a KPI."""
