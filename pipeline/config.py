"""The schema of params.yaml: every key, its range and its default meaning; an unknown key is an error that names the nearest one.

Hydra composes `conf/` into params.yaml once (`compose`); everything else reads that file (`load`).
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from pipeline.core.names import nearest
from pipeline.core.space import Space
from pipeline.front_car import FrontCar
from pipeline.lineage import Version, versions
from pipeline.protocols import InputError
from pipeline.scenario import FunctionalScenario

CONF = Path(__file__).resolve().parents[1] / "conf"
PARAMS = Path("params.yaml")
Seed = Annotated[int, Field(ge=0)]
Share = Annotated[float, Field(gt=0, lt=1)]


def _has_target(section: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(section.get("_target_"), str) or "." not in section["_target_"]:
        raise ValueError("needs '_target_', the dotted name of a class")
    return section


Target = Annotated[dict[str, Any], AfterValidator(_has_target)]
"""Something that Hydra instantiates: `_target_` and keyword arguments of that class."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


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


class Comparison(_Section):
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
    goal: Literal["report", "base", "front_car"]
    """`report` runs the loop, `base` stops at the trained base detector, `front_car` runs the front-car study."""
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
    comparison: Comparison
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
            if self.scenarios[other].space != self.scenarios[self.search[0]].space:
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
            if self.scenarios[unseen].space != self.scenarios[first].space:
                raise ValueError(f"held_out: {unseen} has another space than {first}; scenarios that are compared together share one")
            for searched in self.search:
                if self.scenarios[unseen].town.fingerprint == self.scenarios[searched].town.fingerprint:
                    raise ValueError(
                        f"held_out: {unseen} has the town of {searched} (style and seed), which is searched, so detectors would learn it"
                    )
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
        return versions(self.retraining.rounds, self.retraining.seeds)

    def space(self, scenario: str) -> Space:
        """The logical scenario space of a scenario; InputError that names the variable that is wrong."""
        try:
            return Space.from_dict(self.scenarios[scenario].space)
        except (TypeError, ValueError) as error:
            raise InputError(f"scenarios.{scenario}.space: {error}") from error


def _known(key: str, name: str, known: Iterable[str]) -> None:
    if name not in known:
        raise ValueError(f"{key}: there is no '{name}'{nearest(name, known)}")


def validate(plain: Any, source: str) -> Config:
    """Check plain data against the schema; InputError that names the source and the first wrong key."""
    try:
        config = Config.model_validate(plain)
    except ValidationError as error:
        message = _message(error)
        if source == "conf/" and (scenario := re.match(r"scenarios\.(\w+)", message)):
            source = f"conf/scenario/{scenario[1]}.yaml"
        raise InputError(f"{source}: {message}") from error
    for name in config.scenarios:
        config.space(name)
    return config


def _message(error: ValidationError) -> str:
    # An unknown key explains the missing one beside it, so it comes first.
    first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    path = [str(part) for part in first["loc"]]
    if first["type"] == "extra_forbidden":
        return f"unknown key '{'.'.join(path)}'{nearest(path[-1], _keys(path[:-1]))}"
    key, text = ".".join(path), first["msg"].removeprefix("Value error, ")
    if first["type"] == "missing":
        return f"key '{key}' is missing"
    got = "" if isinstance(first["input"], dict) else f", got {first['input']!r}"
    return f"{key}: {text}{got}" if key else text


def _keys(path: Sequence[str]) -> list[str]:
    """Known keys of the section at a path of the schema."""
    model: Any = Config
    for part in path:
        fields = getattr(model, "model_fields", {})
        if part in fields:
            model = fields[part].annotation
        if get_args(model):
            model = next((a for a in get_args(model) if isinstance(a, type) and issubclass(a, BaseModel)), model)
    return list(getattr(model, "model_fields", {}))


def check_targets(config: Config) -> None:
    """Check that each `_target_` exists and takes the keys beside it, and that named files are there; InputError that names the key."""
    sections = {"simulator": config.simulator, "detector": config.detector}
    sections |= {f"samplers.{name}": section for name, section in config.samplers.items()}
    for key, section in sections.items():
        parameters = _parameters(f"{key}._target_", section["_target_"])
        for name in section:
            if name != "_target_" and name not in parameters:
                raise InputError(f"unknown key '{key}.{name}'{nearest(name, parameters)}")
    if "model" in config.detector:
        raise InputError("detector.model is the version under test's; `python -m pipeline test-detector FILE` tests another detector")
    if config.filter.overrules is not None and not Path(config.filter.overrules).is_file():
        raise InputError(f"filter.overrules: expected a CSV, found no file {config.filter.overrules}")
    if config.base.source == "shipped" and not (weights := Path(config.base.weights) / "weights.safetensors").is_file():
        raise InputError(f"base.weights: expected the folder of a detector, found no file {weights}")
    learning = {
        name for name, section in config.samplers.items() if "earlier" in _parameters(f"samplers.{name}._target_", section["_target_"])
    }
    for name in config.campaign.transfer:
        if name not in learning:
            target = config.samplers[name]["_target_"]
            raise InputError(f"campaign.transfer: '{name}' ({target}) takes no tests of other campaigns, it has no parameter 'earlier'")
    if (frozen := config.comparison.strategy) in learning:
        raise InputError(f"comparison.strategy: '{frozen}' learns from results, so each version would be given other tests")


def _parameters(key: str, target: str) -> list[str]:
    module, _, name = target.rpartition(".")
    try:
        found = getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise InputError(f"{key}: there is no '{target}' ({error})") from error
    return [parameter for parameter in inspect.signature(found).parameters if parameter != "self"]


def compose(study: str, overrides: Sequence[str]) -> Config:
    """Compose a study from conf/ with Hydra's overrides and check it."""
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    studies = [path.stem for path in (CONF / "study").glob("*.yaml")]
    if study not in studies:
        raise InputError(f"there is no study '{study}'{nearest(study, studies)}")
    with initialize_config_dir(str(CONF), version_base="1.3"):

        def composed(words: Sequence[str]) -> Any:
            return OmegaConf.to_container(hydra_compose("config", overrides=[f"study={study}", *words]), resolve=True)

        plain = composed([])
        try:
            # Which scenarios a study needs is known only after its own overrides; theirs come last.
            chosen = [word for word in overrides if not word.lstrip("+~").startswith("scenario")]
            scenarios = _scenarios(composed(chosen) if chosen else plain)
            plain = composed(scenarios)
            if overrides:
                plain = composed([*scenarios, *overrides])
        except (HydraException, OmegaConfBaseException) as error:
            raise InputError(_override_message(plain, overrides) or f"overrides: {str(error).splitlines()[0]}") from error
    config = validate(plain, "conf/")
    check_targets(config)
    return config


def _scenarios(plain: Any) -> list[str]:
    """Overrides that load the scenarios of the lists `search` and `held_out` from conf/scenario."""
    files = [path.stem for path in (CONF / "scenario").glob("[!_]*.yaml")]
    words = []
    for key in ("search", "held_out"):
        for name in plain[key] if isinstance(plain[key], list) else []:
            if name not in files:
                raise InputError(f"{key}: there is no conf/scenario/{name}.yaml{nearest(str(name), files)}")
            words.append(f"+scenario@scenarios.{name}={name}")
    return list(dict.fromkeys(words))


def functional_scenario(name: str) -> FunctionalScenario:
    """A scenario of conf/scenario/ by its file's name."""
    other = "F1" if name == "F1star" else "F1star"
    return compose("default", [f"search=[{name}]", f"held_out=[{other}]"]).scenarios[name]


def _override_message(plain: Any, overrides: Sequence[str]) -> str:
    """Which override names a key that is not there; empty if none does."""
    for override in overrides:
        section, path = plain, override.partition("=")[0].lstrip("+~").split(".")
        for part in path:
            if not isinstance(section, dict) or part not in section:
                known = section if isinstance(section, dict) else []
                return f"unknown key '{'.'.join(path)}'{nearest(part, known)}"
            section = section[part]
    return ""


def dump(config: Config, command: str) -> str:
    """The text of params.yaml."""
    body = yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, width=120, default_flow_style=None)
    return f"# Made by `{command}`; change conf/ or the overrides, not this file.\n{body}"


def load(path: Path = PARAMS) -> Config:
    """Read params.yaml; InputError that names the file and key."""
    try:
        plain = yaml.safe_load(path.read_text())
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; make it by `python -m pipeline compose study=default`") from error
    except yaml.YAMLError as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"{path}{f', line {mark.line + 1}' if mark else ''}: no YAML ({problem})") from error
    return validate(plain, str(path))
