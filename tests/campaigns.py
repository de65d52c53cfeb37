"""Campaigns on the analytic simulator: their study, their files, and worlds that go wrong."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.core.encounter import Encounter
from pipeline.core.space import Value
from pipeline.errors import SimulationError
from pipeline.simulators.analytic import AnalyticWorld
from tests.studies import StudyFolder

OVERRIDES = [
    "simulator=analytic",
    "detector=oracle",
    "seeds=[3]",
    "campaign.tests=24",
    "samplers.mixed.batch_size=8",
]
FILES = ("tests.parquet", "signals.parquet", "frames.parquet")
MODEL = "models/base/model.onnx"


def analytic_study(root: Path, *overrides: str) -> StudyFolder:
    """A study on the analytic simulator, with its scenarios' spaces and a stand-in for a model."""
    study = StudyFolder.composed(root, "smoke", [*OVERRIDES, *overrides])
    for scenario in ("F1", "F2", "F1star"):
        assert study.run("define-space", scenario=scenario) == 0
    (study / MODEL).parent.mkdir(parents=True)
    (study / MODEL).write_bytes(b"the oracle needs none")
    return study


def key(strategy: str = "mixed", scenario: str = "F1", kind: str = "campaigns") -> dict[str, Any]:
    """The names of a campaign, as its step takes them."""
    return {"kind": kind, "scenario": scenario, "strategy": strategy, "version": "base", "seed": 3}


def folder(
    study: StudyFolder, strategy: str = "mixed", scenario: str = "F1", kind: str = "campaigns"
) -> Path:
    """Where a campaign's tables are."""
    return study / "/".join(map(str, key(strategy, scenario, kind).values()))


def journal(study: StudyFolder) -> Path:
    """Where the campaign keeps its finished tests until it ends."""
    return study / "/".join(["journal", "campaign", *map(str, key().values())])


def same(first: Path, other: Path) -> bool:
    """Whether two campaigns' tables have the same bytes."""
    return all((first / name).read_bytes() == (other / name).read_bytes() for name in FILES)


class Slow(AnalyticWorld):
    """Slows execution down, so that a test can kill it between two executions."""

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        time.sleep(0.1)
        return super().reset(concrete, seed)


class Fragile(AnalyticWorld):
    """Reports an error in thick fog and kills its process in heavy rain."""

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        if float(concrete["fog"]) > 70:
            raise SimulationError("too much fog to simulate")
        if float(concrete["rain"]) > 92:
            os._exit(9)
        return super().reset(concrete, seed)
