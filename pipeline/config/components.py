"""The classes that `_target_` names in conf/: checked before any work begins, and made when they are needed."""

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
    """What a class must be. given: parameters that it gets from the pipeline and must take. offered: others that it may take."""

    protocol: type
    given: tuple[str, ...]
    offered: tuple[str, ...] = ()

    @property
    def methods(self) -> tuple[str, ...]:
        return tuple(
            name
            for name, member in vars(self.protocol).items()
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
    """The detector of a section of the config. It also gives detections below its threshold, from `STORED_FROM`: the car ignores them."""
    checked = component("detector", DETECTOR, section)
    lower = (
        {"threshold": min(STORED_FROM, float(section["threshold"]))}
        if "threshold" in section
        else {}
    )
    made: Detector = checked(model=str(model), **lower)
    return made


def make_sampler(section: Mapping[str, Any], space: Space, seed: int, **earlier: Any) -> Sampler:
    """The strategy of a section of the config. earlier: tests of earlier campaigns."""
    made: Sampler = component("sampler", SAMPLER, section)(space=space, seed=seed, **earlier)
    return made


def component(key: str, kind: Kind, section: Mapping[str, Any]) -> Callable[..., Any]:
    """The class of a section with its settings, which lacks only what the pipeline gives; InputError that names the key.

    Only a class of the right kind is made, and nothing that a value in the section names.
    """
    found = _class(f"{key}._target_", kind, section["_target_"])
    return partial(
        found,
        **_settings(
            key, kind, found, {name: value for name, value in section.items() if name != "_target_"}
        ),
    )


def check_components(config: Config) -> None:
    """Check every class and all its settings, and that named files exist; InputError that names the key.

    Strategies are made. Of worlds and detectors, which need OpenGL and a model, the signature is checked.
    """
    component("simulator", WORLD, config.simulator)
    _check_needs(config)
    _check_points(config)
    component("detector", DETECTOR, config.detector)
    _check_threshold(config)
    for name, section in config.samplers.items():
        used = (
            config.search
            if name in config.strategies
            else config.held_out
            if name == config.comparison.strategy
            else config.search[:1]
        )
        made = component(f"samplers.{name}", SAMPLER, section)
        for scenario in used:
            try:
                made(space=config.space(scenario), seed=0)
            except ValueError as error:
                raise InputError(f"samplers.{name}: {error}") from error
    _check_files(config)
    _check_learning(config)
    for scenario in config.search if config.goal in ("report", "detectors") else ():
        config.exposure.of(scenario, config.space(scenario))
    if config.audited and not config.independent(AUDIT):
        raise InputError(
            f"samplers.{AUDIT}: the audit needs a class whose tests are independent; or set campaign.audit=0"
        )


def _check_files(config: Config) -> None:
    """The files that a person names are there."""
    if config.filter.overrules is not None and not Path(config.filter.overrules).is_file():
        raise InputError(
            f"filter.overrules: expected a CSV, found no file {config.filter.overrules}"
        )
    for kind in (
        ("weights", "card", "curve")
        if config.base.source == "shipped" or config.goal == "front_car"
        else ()
    ):
        if not (file := Path(config.base.weights, VERSION_FILES[kind])).is_file():
            raise InputError(
                f"base.weights: expected the folder of a detector, found no file {file}"
            )
    for name, path in config.tested.items() if config.goal == "detectors" else ():
        if not Path(path).exists():
            raise InputError(
                f"tested.{name}: expected the file or folder of a detector, found no {path}"
            )
        if (
            path.endswith(WEIGHTS_SUFFIX)
            and not (card := Path(path).with_name(VERSION_FILES["card"])).is_file()
        ):
            raise InputError(
                f"tested.{name}: expected the card of these weights beside them, found no {card}"
            )


def _check_needs(config: Config) -> None:
    """The variables of each scenario are those that the simulator needs; it uses others if it is not closed."""
    target = config.simulator["_target_"]
    simulator = _class("simulator._target_", WORLD, target)
    needs: Mapping[str, Admitted] = getattr(simulator, "needs", {})
    for scenario in (*config.search, *config.held_out):
        variables = {variable.name: variable for variable in config.space(scenario).variables}
        if unused := [
            name for name in variables if name not in needs and getattr(simulator, "closed", False)
        ]:
            raise InputError(
                f"scenarios.{scenario}.space.{unused[0]}: {target} does not use this variable"
            )
        for name, admitted in needs.items():
            key = f"scenarios.{scenario}.space.{name}"
            if name not in variables:
                raise InputError(f"key '{key}' is missing: {target} needs this variable")
            if admitted and not _inside(variables[name], admitted):
                wanted = (
                    f"values among {', '.join(map(str, admitted))}"
                    if isinstance(admitted[0], str)
                    else f"numbers in {list(admitted)}"
                )
                raise InputError(
                    f"{key}: {target} takes {wanted}, got {shown(variables[name].to_dict())}"
                )


def _check_points(config: Config) -> None:
    """The constraints of each scenario leave enough of its space to draw points from."""
    for scenario in (*config.search, *config.held_out):
        try:
            config.space(scenario).sample(1, np.random.default_rng(0))
        except InputError as error:
            raise InputError(f"scenarios.{scenario}.{error}") from error


def _check_threshold(config: Config) -> None:
    """A detector that takes a threshold gets it from the config: the study judges and brakes by it, too."""
    parameters = inspect.signature(
        _class("detector._target_", DETECTOR, config.detector["_target_"])
    ).parameters
    if "threshold" in parameters and "threshold" not in config.detector:
        raise InputError(
            "key 'detector.threshold' is missing: the study judges and brakes by it, too"
        )


def _inside(variable: Variable, admitted: Admitted) -> bool:
    if variable.kind == "categorical":
        return set(variable.values) <= set(admitted)
    return (
        not isinstance(admitted[0], str)
        and float(admitted[0]) <= variable.low
        and variable.high <= float(admitted[1])
    )


def _check_learning(config: Config) -> None:
    """InputError for a strategy that must learn from other campaigns and cannot, and for one that must not learn at all and does."""
    found = {
        name: _class(f"samplers.{name}._target_", SAMPLER, section["_target_"])
        for name, section in config.samplers.items()
    }
    for name in config.campaign.transfer:
        if "earlier" not in inspect.signature(found[name]).parameters:
            target = config.samplers[name]["_target_"]
            raise InputError(
                f"campaign.transfer: '{name}' ({target}) takes no tests of other campaigns: it has no parameter 'earlier'"
            )
    if config.learns(frozen := config.comparison.strategy):
        raise InputError(
            f"comparison.strategy: '{frozen}' learns from results, so each version would get different tests"
        )


def _class(key: str, kind: Kind, target: str) -> type:
    found = named(key, target)
    *most, last = kind.methods
    methods = f"{', '.join(most)} and {last}" if most else last
    wanted = f"{key}: expected a class with {methods}, a {kind.protocol.__name__}"
    if not isinstance(found, type) or not all(
        callable(getattr(found, method, None)) for method in kind.methods
    ):
        raise InputError(f"{wanted}, got {shown(target)}")
    if inspect.isabstract(found) or getattr(found, "_is_protocol", False):
        raise InputError(f"{wanted} that can be instantiated; {shown(target)} is abstract")
    parameters = inspect.signature(found).parameters
    for given in kind.given:
        if given not in parameters and not any(
            p.kind is p.VAR_KEYWORD for p in parameters.values()
        ):
            raise InputError(f"{key}: {shown(target)} must take the parameter '{given}'")
    return found


def _settings(key: str, kind: Kind, found: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a section as the annotations of its class want them."""
    for name in (*kind.given, *kind.offered):
        if name in values:
            raise InputError(
                f"{key}.{name} is set by the study; leave it out{TESTED if name == 'model' else ''}"
            )
    parameters = {
        name: p
        for name, p in inspect.signature(found).parameters.items()
        if name not in (*kind.given, *kind.offered)
    }
    if open_ended := any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        parameters = {name: p for name, p in parameters.items() if p.kind is not p.VAR_KEYWORD}
    for name in () if open_ended else values:
        if name not in parameters:
            raise InputError(f"unknown key '{key}.{name}'{nearest(name, parameters)}")
    schema = _schema(found, parameters)
    try:
        checked = schema.model_validate_json(
            json.dumps({name: value for name, value in values.items() if name in parameters})
        )
    except ValidationError as error:
        raise InputError(message(error, schema, f"{key}.")) from error
    return {**values, **{name: getattr(checked, name) for name in checked.model_fields_set}}


TESTED = ": `python -m pipeline test-detector FILE` tests another detector"


def _schema(found: type, parameters: Mapping[str, inspect.Parameter]) -> type[BaseModel]:
    """The signature of a class as a strict schema; a parameter with an annotation that says nothing to pydantic may be anything."""
    config = ConfigDict(
        strict=True, allow_inf_nan=False, arbitrary_types_allowed=True, protected_namespaces=()
    )
    hints = _hints(found)
    fields: dict[str, Any] = {
        name: (
            hints.get(name, Any),
            ... if parameter.default is parameter.empty else parameter.default,
        )
        for name, parameter in parameters.items()
        if parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
    }
    made: type[BaseModel]
    try:
        made = create_model(found.__name__, __config__=config, **fields)
    except PydanticUserError:
        anything: dict[str, Any] = {name: (Any, default) for name, (_, default) in fields.items()}
        made = create_model(found.__name__, __config__=config, **anything)
    return made


def _hints(found: type) -> dict[str, Any]:
    """The annotations of the constructor's parameters; those of a dataclass are its fields', which it may inherit from other modules."""
    hints: dict[str, Any] = {}
    for described in (found, inspect.getattr_static(found, "__init__")):
        try:
            hints |= get_type_hints(described, include_extras=True)
        except (NameError, TypeError, AttributeError):
            continue
    return hints
