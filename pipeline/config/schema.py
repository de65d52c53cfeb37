"""The schema of params.yaml: every key, its range and its default meaning; an unknown key is an error that names the nearest one.

Hydra composes `conf/` into params.yaml once (`compose`); everything else reads that file (`load`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from pipeline.core.lineage import Version, versions
from pipeline.core.names import nearest
from pipeline.core.space import Space
from pipeline.scenarios.front_car import FrontCar
from pipeline.scenarios.functional import FunctionalScenario

Seed = Annotated[int, Field(ge=0)]
Share = Annotated[float, Field(gt=0, lt=1)]


DetectorName = Annotated[str, Field(pattern=r"^[A-Za-z0-9]\w*$")]


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
            """Only what `declared` left out is missing here."""
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
    """A test whose adjusted TTC is at or below it is a failure (Eq. 6.1)."""
    transfer: tuple[str, ...]
    """Strategies whose campaigns know those on the scenarios before them in `search`; they run one after another then."""


class HeldOutSequence(_Section):
    """The frozen held-out sequence on which all model versions are compared."""

    tests: int = Field(ge=1, le=100_000)
    """How much of the pair-wise sequence is executed."""
    strategy: str
    """The test strategy that makes the sequence; it must not learn from results."""
    seed: Seed
    """Of the sequences; each held-out scenario has one of its own."""
    alpha: Share
    """Level of each paired test; they are not corrected for their number."""
    confidence: Share
    """Of all intervals."""


class BaseSet(_Section):
    """The random base training set."""

    images: int = Field(ge=10, le=1_000_000)
    """How many are rendered, training and validation together."""
    validation_share: float = Field(gt=0, lt=0.9)
    """Share of each town's images that validates."""
    seed: Seed
    """Of towns, scenes and weather."""


class Base(_Section):
    """Where the model version `base` comes from."""

    source: Literal["shipped", "trained"]
    """`shipped` takes `weights`, `trained` trains from scratch on the base set."""
    weights: str
    """Folder of the shipped detector."""


class Training(_Section):
    """Training from scratch."""

    size: Literal["nano", "small"]
    """Of the network: 1.1 or 2.6 million parameters."""
    seed: Seed
    """Of weights, order and augmentation."""
    batch_size: int = Field(ge=1, le=4096)
    """Images a step."""
    crop_iterations: int = Field(ge=0)
    """Batches of crops, with a quarter of a frame's pixels."""
    frame_iterations: int = Field(ge=0)
    """Batches of full frames after them: only they show near pedestrians whole."""
    learning_rate: float = Field(gt=0, lt=1)
    """The highest of the schedule."""
    oversampling: int = Field(ge=1, le=20)
    """How often an epoch shows an image whose pedestrian is hard to find."""
    validate_every: int = Field(ge=1)
    """Iterations between looks at 500 validation images."""
    patience: int = Field(ge=1)
    """Looks without a better AP50 after which training stops with the best weights."""


class Retraining(_Section):
    """Retraining of the versions control, random and adaptive: all with the same steps."""

    seeds: tuple[Seed, ...] = Field(min_length=1)
    """Of which frames are drawn, of order and augmentation; each makes a version of each kind."""
    rounds: int = Field(ge=1, le=20)
    """How often search, filter and retraining are repeated on the newest versions."""
    start: Literal["parent", "scratch"]
    """`parent` goes on from the version before, `scratch` trains anew with section `training` on the base set and the added frames."""
    selection: Literal["all", "failures", "regions"]
    """Which kept frames are added: of all tests, of failed ones, or of failed ones with equal numbers from every failure region."""
    batch_size: int = Field(ge=2, le=4096)
    """Full frames a step."""
    iterations: int = Field(ge=1)
    """Steps."""
    learning_rate: float = Field(gt=0, lt=1)
    """The highest of the schedule."""
    added_share: Share
    """Share of a batch that comes from the campaigns; the rest, and all of the control's, from the base set."""
    added_frames: int = Field(ge=1)
    """At most so many added frames a round; never more than the smaller of the two sources has."""
    empty_share: Share
    """Share of the added frames in which no pedestrian shows; the same for both sources."""


class Filter(_Section):
    """Which campaign frames may be learnt from."""

    min_visible_pixels: int = Field(ge=0)
    """A pedestrian of which fewer pixels show is no fair label."""
    min_detectability: float = Field(ge=0)
    """Contrast to the surroundings in grey levels times the square root of the visible pixels below which a person hardly sees it."""
    overrules: str | None
    """A person's CSV with test_id, step, keep."""


class Regions(_Section):
    """Failure regions."""

    chance_neighbours: float = Field(gt=0, le=10)
    """Sets the radius of the density clusters: so wide that failures spread evenly over the space would have so many others in it."""
    min_failures: int = Field(ge=2)
    """Failures within the radius that make a region."""


class Report(_Section):
    """The report."""

    replays: int = Field(ge=0, le=100)
    """Replay videos at most."""


class Tracking(_Section):
    """MLflow."""

    experiment: str
    """Name of the MLflow experiment."""
    model_name: str
    """Name of the registered model."""


class Config(_Section):
    """A study."""

    study: str = Field(pattern=r"^[a-z0-9_-]+$")
    """Its name; results lie in data/<study>."""
    goal: Literal["report", "base", "front_car", "detectors"]
    """`report` runs the loop, `base` stops at the trained base detector, `front_car` runs the front-car study, `detectors` tests the
    detectors in `tested` and retrains none."""
    tested: dict[DetectorName, str]
    """The detectors that goal `detectors` tests: name and file; the first is the one that the others are compared with."""
    seeds: tuple[Seed, ...] = Field(min_length=1)
    """Seeds of the search campaigns; with the same one each scenario has tests of its own."""
    search: tuple[str, ...] = Field(min_length=1)
    """Scenarios that are searched."""
    held_out: tuple[str, ...] = Field(min_length=1)
    """Scenarios for the comparison alone."""
    strategies: tuple[str, ...] = Field(min_length=1)
    """Test strategies of the search; the first is the baseline and feeds D_r."""
    adaptive: str
    """The strategy that feeds D_a."""
    scenarios: dict[str, FunctionalScenario]
    """The functional scenarios that both lists name, from conf/scenario."""
    samplers: dict[str, Target]
    """The test strategies, from conf/sampler."""
    simulator: Target
    """What executes a test, from conf/simulator."""
    detector: Target
    """What is tested, from conf/detector."""
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
                    f"campaign.transfer: {other} has another space than {self.search[0]}, but what is known of tests needs one space"
                )
        _known("comparison.strategy", self.comparison.strategy, self.samplers)
        _known("adaptive", self.adaptive, self.strategies)
        for key, seeds in {"seeds": self.seeds, "retraining.seeds": self.retraining.seeds}.items():
            if len(set(seeds)) < len(seeds):
                raise ValueError(f"{key} must differ, got {list(seeds)}")
        for name in self.samplers:
            if not re.fullmatch(r"\w+", name):
                raise ValueError(f"samplers: expected letters, digits and _ in a name, as tests are named after it, got '{name}'")
        if both := set(self.search) & set(self.held_out):
            raise ValueError(f"held_out must not be searched: {', '.join(sorted(both))} is in both lists")
        for unseen in self.held_out:
            first = self.held_out[0]
            if self.space(unseen) != self.space(first):
                raise ValueError(f"held_out: {unseen} has another space than {first}; scenarios that are compared together share one")
            for searched in self.search:
                if self.scenarios[unseen].town.fingerprint == self.scenarios[searched].town.fingerprint:
                    raise ValueError(
                        f"held_out: {unseen} has the town of {searched} (style and seed), which is searched, so detectors would learn it"
                    )
        if self.goal == "detectors" and not self.tested:
            raise ValueError("tested: goal 'detectors' needs at least one detector, as in +tested.mine=best.onnx")
        if self.adaptive == self.strategies[0]:
            raise ValueError(f"adaptive must differ from the baseline, the first of strategies, got '{self.adaptive}' for both")
        return self

    def earlier(self, scenario: str, strategy: str) -> tuple[str, ...]:
        """The scenarios whose campaigns are known to the campaign of a strategy on a scenario."""
        if strategy not in self.campaign.transfer or scenario not in self.search:
            return ()
        return self.search[: self.search.index(scenario)]

    @property
    def sources(self) -> dict[str, str]:
        """The strategies whose frames are learnt from, by the kind of version that learns from them."""
        return {"random": self.strategies[0], "adaptive": self.adaptive}

    @property
    def searched(self) -> frozenset[tuple[str, str]]:
        """Strategy and version of every search campaign, those of later rounds included."""
        later = {(self.sources[v.kind], str(v)) for version in self.versions for v in version.tested if v.kind in self.sources}
        return frozenset(later.union((strategy, "base") for strategy in self.strategies))

    @property
    def versions(self) -> tuple[Version, ...]:
        """The model versions of the study."""
        if self.goal == "detectors":
            return tuple(map(Version, self.tested))
        return versions(self.retraining.rounds, self.retraining.seeds)

    def space(self, scenario: str) -> Space:
        """The logical scenario space of a scenario."""
        return self.scenarios[scenario].logical_space()


def _known(key: str, name: str, known: Iterable[str]) -> None:
    if name not in known:
        raise ValueError(f"{key}: there is no '{name}'{nearest(name, known)}")


def held_out_towns(config: Config) -> tuple[str, ...]:
    """The keys that say which towns no version may learn."""
    return ("held_out", *(f"scenarios.{name}.town" for name in config.held_out))


FAN_OUT = (
    *("study", "search", "held_out", "seeds", "strategies", "adaptive", "retraining.rounds", "retraining.seeds"),
    *("comparison.strategy", "comparison.seed", "campaign.transfer"),
)
"""The keys that say which jobs a study has, and which of them read what."""
