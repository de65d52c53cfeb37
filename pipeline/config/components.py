"""Checks the classes that `_target_` names in conf/, samplers, simulators and detectors, before any work begins."""

from __future__ import annotations

import inspect
from importlib import import_module
from pathlib import Path

from pipeline.config.schema import Config
from pipeline.core.names import nearest
from pipeline.errors import InputError


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
