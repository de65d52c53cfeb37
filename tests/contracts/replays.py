"""Replays of shipped scenarios in the MuJoCo world."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.core import kpi
from pipeline.core.loop import run_test
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.scenarios.functional import FunctionalScenario
from pipeline.simulators.mujoco.world import MujocoWorld
from pipeline.testing import CAR

CONF = Path(__file__).resolve().parents[2] / "conf" / "scenario"


def described(name: str) -> FunctionalScenario:
    """A shipped scenario, by the name of its file."""
    plain = {
        **yaml.safe_load((CONF / "_space.yaml").read_text()),
        **yaml.safe_load((CONF / f"{name}.yaml").read_text()),
    }
    del plain["defaults"]
    return FunctionalScenario.model_validate_json(json.dumps(plain))


def signature(world: MujocoWorld, concrete: dict[str, Any]) -> list[Any]:
    """What a replay must repeat to the bit: sums of images, the KPI, contrasts."""
    episode = run_test(world, VisiblePixelOracle(), CAR, concrete, keep_every=1)
    images = [int(kept.frame.image.astype(np.int64).sum()) for kept in episode.frames]
    return [
        images,
        kpi.evaluate(episode.signals, 0.1).adj_ttc_s.hex(),
        episode.signals["contrast"].tolist(),
    ]
