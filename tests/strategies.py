"""Every strategy of conf/sampler, for the laws and contracts that all of them keep."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.config.composing import CONF
from pipeline.core.samplers.batches import BatchSampler
from pipeline.core.space import Floats, Space

Strategy = Callable[..., BatchSampler]


def kpi_of(points: Floats) -> Floats:
    """Falls with the first variable; one test in seven is an error."""
    values = 1.05 - points[:, 0] / 10
    return np.where(np.arange(len(points)) % 7 == 3, np.nan, values)


def strategies(conf: Path = CONF) -> dict[str, Strategy]:
    """Strategies by name, with the parameters of their files.

    Those that take earlier campaigns also appear with such tests.
    """
    found: dict[str, Strategy] = {}
    for path in sorted((conf / "sampler").glob("*.yaml")):
        section = yaml.safe_load(path.read_text())
        module, _, name = section.pop("_target_").rpartition(".")
        made = getattr(import_module(module), name)
        # Values such as ${campaign.failure_threshold_s} come from a study.
        found[path.stem] = _with(
            made, {key: value for key, value in section.items() if "${" not in str(value)}
        )
        if "earlier" in inspect.signature(made).parameters:
            found[f"{path.stem}-taught"] = _taught(found[path.stem])
    return found


def _with(made: Strategy, values: dict[str, Any]) -> Strategy:
    return lambda space, seed, **settings: made(space, seed, **{**values, **settings})


def _taught(made: Strategy) -> Strategy:
    def taught(space: Space, seed: int, **settings: Any) -> BatchSampler:
        points = space.sample(20, np.random.default_rng(7))
        return made(space, seed, earlier=[(points, kpi_of(points))], **settings)

    return taught
