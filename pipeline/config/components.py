"""The classes that `_target_` names in conf/.

They are checked before any work begins, and instantiated when they are needed.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, create_model
from pydantic.errors import PydanticUserError

from pipeline.config.messages import message
from pipeline.config.schema import AUDIT, Config
from pipeline.config.targets import named
from pipeline.core.braking import Vehicle
from pipeline.core.lineage import VERSION_FILES, WEIGHTS_SUFFIX
from pipeline.core.names import nearest
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError, shown
from pipeline.protocols import Admitted, Detector, Sampler, World
from pipeline.scenarios.functional import FunctionalScenario

STORED_FROM = 0.05
"""Lowest score of a detection that a test stores."""


@dataclass(frozen=True)
class Kind:
    """The requirements on a class.

    given: parameters that it gets from the pipeline and must take. offered: others that it may
    take.
    """

    protocol: type
    given: tuple[str, ...]
    offered: tuple[str, ...] = ()

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods that its protocol asks for."""
        members = vars(self.protocol).items()
        return tuple(
            name
            for name, member in members
            if inspect.isfunction(member) and not name.startswith("_")
        )


WORLD = Kind(World, ("scenario", "vehicle"))
DETECTOR = Kind(Detector, ("model",))
SAMPLER = Kind(Sampler, ("space", "seed"), ("earlier",))


def make_world(section: Mapping[str, Any], scenario: FunctionalScenario, vehicle: Vehicle) -> World:
    """The world of the config's section `simulator`."""
    world: World = component("simulator", WORLD, section)(scenario=scenario, vehicle=vehicle)
    return world


def make_detector(section: Mapping[str, Any], model: Path) -> Detector:
    """The detector of a section of the config.

    It also gives detections below its threshold, from `STORED_FROM`; the car ignores them.
    """
    settings: dict[str, Any] = {"model": str(model)}
    if "threshold" in section:
        settings["threshold"] = min(STORED_FROM, float(section["threshold"]))
    detector: Detector = component("detector", DETECTOR, section)(**settings)
    return detector


def make_sampler(section: Mapping[str, Any], space: Space, seed: int, **earlier: Any) -> Sampler:
    """The strategy of a section of the config. earlier: tests of earlier campaigns."""
    sampler: Sampler = component("sampler", SAMPLER, section)(space=space, seed=seed, **earlier)
    return sampler


def component(key: str, kind: Kind, section: Mapping[str, Any]) -> Callable[..., Any]:
    """The class of a section with its settings; it lacks only the pipeline's parameters.

    Nothing that a value in the section names is instantiated.

    Args:
        key: of the section, for messages.
        kind: the requirements on the class.
        section: `_target_` and settings.

    Raises:
        InputError: a class of another kind, or wrong settings; the message names the key.
    """
    target = _class(f"{key}._target_", kind, section["_target_"])
    values = {name: value for name, value in section.items() if name != "_target_"}
    return partial(target, **_settings(key, kind, target, values))


def check_components(config: Config) -> None:
    """Check every class and all its settings, and that named files exist.

    Strategies are instantiated. Of worlds and detectors, which need OpenGL and a model, the
    signature is checked.

    Raises:
        InputError: the first fault; the message names the key.
    """
    component("simulator", WORLD, config.simulator)
    _check_scenarios(config)
    component("detector", DETECTOR, config.detector)
    # A detector that takes a threshold gets it from the config, since the study judges by it.
    detector = _class("detector._target_", DETECTOR, config.detector["_target_"])
    if "threshold" in inspect.signature(detector).parameters and "threshold" not in config.detector:
        raise InputError(
            "key 'detector.threshold' is missing: the study judges and brakes by it, too"
        )
    for name, section in config.samplers.items():
        scenarios = config.search[:1]
        if name in config.strategies:
            scenarios = config.search
        elif name == config.comparison.strategy:
            scenarios = config.held_out
        sampler = component(f"samplers.{name}", SAMPLER, section)
        for scenario in scenarios:
            try:
                sampler(space=config.space(scenario), seed=0)
            except ValueError as error:
                raise InputError(f"samplers.{name}: {error}") from error
    _check_files(config)
    _check_learning(config)
    for scenario in config.search if config.goal in ("report", "detectors") else ():
        config.exposure.of(scenario, config.space(scenario))
    if config.audited and not config.independent(AUDIT):
        raise InputError(
            f"samplers.{AUDIT}: the audit needs a class whose tests are independent; "
            "or set campaign.audit=0"
        )


def _check_files(config: Config) -> None:
    """The files that a person names are there."""
    overrules = config.filter.overrules
    if overrules is not None and not Path(overrules).is_file():
        raise InputError(f"filter.overrules: expected a CSV, found no file {overrules}")
    if config.base.source == "shipped" or config.goal == "front_car":
        for kind in ("weights", "card", "curve"):
            if not (file := Path(config.base.weights, VERSION_FILES[kind])).is_file():
                raise InputError(
                    f"base.weights: expected the folder of a detector, found no file {file}"
                )
    for name, path in config.tested.items() if config.goal == "detectors" else ():
        if not Path(path).exists():
            raise InputError(
                f"tested.{name}: expected the file or folder of a detector, found no {path}"
            )
        card = Path(path).with_name(VERSION_FILES["card"])
        if path.endswith(WEIGHTS_SUFFIX) and not card.is_file():
            raise InputError(
                f"tested.{name}: expected the card of these weights beside them, found no {card}"
            )


def _check_scenarios(config: Config) -> None:
    """Each scenario has the simulator's variables, and constraints that leave enough points.

    A simulator uses other variables, too, if it is not closed.
    """
    target = config.simulator["_target_"]
    simulator = _class("simulator._target_", WORLD, target)
    needs: Mapping[str, Admitted] = getattr(simulator, "needs", {})
    closed = getattr(simulator, "closed", False)
    for scenario in (*config.search, *config.held_out):
        space, key = config.space(scenario), f"scenarios.{scenario}.space"
        for name in space.names:
            if closed and name not in needs:
                raise InputError(f"{key}.{name}: {target} does not use this variable")
        variables = {variable.name: variable for variable in space.variables}
        for name, admitted in needs.items():
            if name not in variables:
                raise InputError(f"key '{key}.{name}' is missing: {target} needs this variable")
            if admitted and not _inside(variables[name], admitted):
                expected = f"numbers in {list(admitted)}"
                if isinstance(admitted[0], str):
                    expected = f"values among {', '.join(map(str, admitted))}"
                got = shown(variables[name].to_dict())
                raise InputError(f"{key}.{name}: {target} takes {expected}, got {got}")
    for scenario in (*config.search, *config.held_out):
        try:
            config.space(scenario).sample(1, np.random.default_rng(0))
        except InputError as error:
            raise InputError(f"scenarios.{scenario}.{error}") from error


def _inside(variable: Variable, admitted: Admitted) -> bool:
    if variable.kind == "categorical":
        return set(variable.values) <= set(admitted)
    return (
        not isinstance(admitted[0], str)
        and float(admitted[0]) <= variable.low
        and variable.high <= float(admitted[1])
    )


def _check_learning(config: Config) -> None:
    """Strategies that transfer take earlier tests, and the held-out strategy does not learn."""
    classes = {
        name: _class(f"samplers.{name}._target_", SAMPLER, section["_target_"])
        for name, section in config.samplers.items()
    }
    for name in config.campaign.transfer:
        if "earlier" not in inspect.signature(classes[name]).parameters:
            target = config.samplers[name]["_target_"]
            raise InputError(
                f"campaign.transfer: '{name}' ({target}) takes no tests of other campaigns: "
                "it has no parameter 'earlier'"
            )
    if config.learns(frozen := config.comparison.strategy):
        raise InputError(
            f"comparison.strategy: '{frozen}' learns from results, "
            "so each version would get different tests"
        )


def _class(key: str, kind: Kind, target: str) -> type:
    """The class of a dotted name, checked."""
    cls = named(key, target)
    *most, last = kind.methods
    methods = f"{', '.join(most)} and {last}" if most else last
    expected = f"{key}: expected a class with {methods}, a {kind.protocol.__name__}"
    has_methods = all(callable(getattr(cls, method, None)) for method in kind.methods)
    if not isinstance(cls, type) or not has_methods:
        raise InputError(f"{expected}, got {shown(target)}")
    if inspect.isabstract(cls) or getattr(cls, "_is_protocol", False):
        raise InputError(f"{expected} that can be instantiated; {shown(target)} is abstract")
    parameters = inspect.signature(cls).parameters
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()):
        return cls
    for given in kind.given:
        if given not in parameters:
            raise InputError(f"{key}: {shown(target)} must take the parameter '{given}'")
    return cls


def _settings(key: str, kind: Kind, cls: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a section, converted to the types of the class's annotations."""
    of_study = (*kind.given, *kind.offered)
    for name in of_study:
        if name in values:
            hint = TESTED if name == "model" else ""
            raise InputError(f"{key}.{name} is set by the study; leave it out{hint}")
    parameters, open_ended = {}, False
    for name, parameter in inspect.signature(cls).parameters.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            open_ended = True
        elif name not in of_study:
            parameters[name] = parameter
    for name in () if open_ended else values:
        if name not in parameters:
            raise InputError(f"unknown key '{key}.{name}'{nearest(name, parameters)}")
    schema = _schema(cls, parameters)
    named_values = {name: value for name, value in values.items() if name in parameters}
    try:
        checked = schema.model_validate_json(json.dumps(named_values))
    except ValidationError as error:
        raise InputError(message(error, schema, f"{key}.")) from error
    return {**values, **{name: getattr(checked, name) for name in checked.model_fields_set}}


TESTED = ": `python -m pipeline test-detector FILE` tests another detector"


def _schema(cls: type, parameters: Mapping[str, inspect.Parameter]) -> type[BaseModel]:
    """The signature of a class as a strict schema.

    A parameter may be anything if pydantic does not know its annotation.
    """
    config = ConfigDict(
        strict=True, allow_inf_nan=False, arbitrary_types_allowed=True, protected_namespaces=()
    )
    # The annotations of a dataclass's constructor are those of its fields, which it may inherit
    # from other modules.
    hints: dict[str, Any] = {}
    for annotated in (cls, inspect.getattr_static(cls, "__init__")):
        try:
            hints |= get_type_hints(annotated, include_extras=True)
        except (NameError, TypeError, AttributeError):
            continue
    fields: dict[str, Any] = {}
    for name, parameter in parameters.items():
        if parameter.kind is not parameter.VAR_POSITIONAL:
            default = ... if parameter.default is parameter.empty else parameter.default
            fields[name] = (hints.get(name, Any), default)
    schema: type[BaseModel]
    try:
        schema = create_model(cls.__name__, __config__=config, **fields)
    except PydanticUserError:
        fields = {name: (Any, default) for name, (_, default) in fields.items()}
        schema = create_model(cls.__name__, __config__=config, **fields)
    return schema
