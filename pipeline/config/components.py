"""The classes that `_target_` names in conf/: checked before any work begins, and made when they are needed."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline.config.schema import Config
from pipeline.core.car import Car
from pipeline.core.names import nearest
from pipeline.errors import InputError
from pipeline.protocols import Detector, Simulator
from pipeline.scenarios.functional import FunctionalScenario

STORED_FROM = 0.05
"""Lowest score of a detection that a test stores."""


def make_simulator(section: Mapping[str, Any], scenario: FunctionalScenario, car: Car) -> Simulator:
    """The simulator of a section of the config."""
    from hydra.utils import instantiate  # Not part of the core.

    # Partial, because Hydra would turn the scenario into a config.
    made: Simulator = instantiate(section, _partial_=True, _convert_="all")(scenario=scenario, car=car)
    return made


def make_detector(section: Mapping[str, Any], model: Path) -> Detector:
    """The detector of a section of the config. It also gives detections below its threshold, from `STORED_FROM`: the car ignores them."""
    from hydra.utils import instantiate

    if "threshold" in section:
        section = {**section, "threshold": min(STORED_FROM, float(section["threshold"]))}
    made: Detector = instantiate(section, _partial_=True, _convert_="all")(model=str(model))
    return made


def check_targets(config: Config) -> None:
    """Check that each `_target_` exists and accepts the keys beside it, and that named files exist; InputError that names the key."""
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
            raise InputError(f"campaign.transfer: '{name}' ({target}) takes no tests of other campaigns: it has no parameter 'earlier'")
    if (frozen := config.comparison.strategy) in learning:
        raise InputError(f"comparison.strategy: '{frozen}' learns from results, so each version would get different tests")


def _parameters(key: str, target: str) -> list[str]:
    module, _, name = target.rpartition(".")
    try:
        found = getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise InputError(f"{key}: there is no '{target}' ({error})") from error
    return [parameter for parameter in inspect.signature(found).parameters if parameter != "self"]
