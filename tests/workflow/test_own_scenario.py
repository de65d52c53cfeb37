"""A scenario is one YAML, a strategy one class with one YAML; a scenario's constraints hold."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hydra.utils import instantiate

from pipeline.analysis.measures import measure_campaign
from pipeline.artefacts import tables
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.scenario_space import read_space
from pipeline.commands.simulate import concrete_scenario
from pipeline.config import composing
from pipeline.config.composing import compose
from pipeline.config.schema import Config
from pipeline.core import kpi
from pipeline.core.identity import CampaignId
from pipeline.core.loop import run_test
from pipeline.core.measures import pair_coverage
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.errors import InputError
from pipeline.simulators.analytic import AnalyticWorld
from pipeline.testing import CAR, check_sampler
from tests.spaces import CONSTRAINED
from tests.strategies import strategies
from tests.studies import StudyFolder

OWN = """
constraints:
  - [animation != crouching, pedestrian_speed = 0]
  - ["rain = [0, 20)", fog = 0]
space:
  rain: {kind: continuous, unit: "%", low: 0, high: 100, cuts: [20, 60]}
  fog: {kind: continuous, unit: "%", low: 0, high: 100, step: 50}
  sun_altitude: {kind: continuous, unit: deg, low: -20, high: 90, step: 55}
  pedestrian_speed: {kind: continuous, unit: m/s, low: 0, high: 3, step: 1.5}
  animation: {kind: categorical, values: [walking, crouching, stumble]}
"""
STRATEGY = '''
from dataclasses import dataclass

from pipeline.core.samplers.batches import BatchSampler


@dataclass(eq=False, repr=False, kw_only=True)
class Centred(BatchSampler):
    """Draws at random and takes the middle of each category.

    hurry: does nothing.
    """

    hurry: float = 1.0

    def _choose(self, index, points, kpi, rng):
        points = self.space.sample(self.batch_size, rng)
        return self.space.representatives(self.space.categorise(points))
'''


@pytest.fixture(scope="module")
def conf(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A copy of conf/ with one more scenario and strategy."""
    root = tmp_path_factory.mktemp("own")
    conf = root / "conf"
    shutil.copytree(composing.CONF, conf)
    # A small space instead of the shared one.
    (conf / "scenario" / "G1.yaml").write_text(
        (conf / "scenario" / "F1.yaml").read_text().partition("defaults: [_space, _self_]")[2] + OWN
    )
    (conf / "sampler" / "centred.yaml").write_text(
        "_target_: own_strategies.Centred\nbatch_size: 8\n"
    )
    (root / "own_strategies.py").write_text(STRATEGY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(composing, "CONF", conf)
        patch.syspath_prepend(str(root))
        yield conf


@pytest.fixture(scope="module")
def study(conf: Path, tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    """A study with the campaign of the pair-wise strategy on the own scenario."""
    overrides = [
        "search=[G1]",
        "strategies=[pairwise,mixed]",
        "arms.random=pairwise",
        "simulator=analytic",
        "detector=oracle",
        "campaign.tests=24",
    ]
    study = StudyFolder.composed(tmp_path_factory.mktemp("study"), "smoke", overrides)
    for scenario in ("G1", "F1star"):
        assert study.run("define-space", scenario=scenario) == 0
    model = study / "models/base/model.onnx"
    model.parent.mkdir(parents=True)
    model.write_bytes(b"the oracle needs none")
    assert (
        study.run(
            "campaign", kind="campaigns", scenario="G1", strategy="pairwise", version="base", seed=0
        )
        == 0
    )
    return study


@pytest.fixture(scope="module")
def config(study: StudyFolder) -> Config:
    return composing.load(study.root / "params.yaml")


@pytest.fixture(scope="module")
def tests(study: StudyFolder) -> pd.DataFrame:
    return tables.read_tests(study / "campaigns/G1/pairwise/base/0/tests.parquet")


def test_the_space_file_contains_the_constraints(study: StudyFolder, config: Config) -> None:
    info, space = read_space(study / "space/G1.json")
    assert space == config.space("G1") and len(space.clauses) == 2
    # 10 planes of 3 x 3 cells, minus two for crouching at a speed and four for rain with fog.
    assert info.pairs == 90 - 6
    assert '"constraints"' not in (study / "space/F1star.json").read_text()


def test_a_full_pairwise_plan_covers_every_feasible_pair_and_breaks_no_clause(
    tests: pd.DataFrame, config: Config
) -> None:
    space = config.space("G1")
    key = CampaignId("G1", "pairwise", "base", 0)
    measured = measure_campaign(key, {key: tests}, {"G1": space}, "pairwise")
    assert measured.pair_coverage_tests == 1 == pair_coverage(space, encode_tests(tests, space))
    assert not ((tests["animation"] == "crouching") & (tests["pedestrian_speed"] >= 0.75)).any()
    assert not ((tests["rain"] >= 20) & (tests["fog"] >= 25)).any()


def test_every_strategy_respects_the_constraints(config: Config) -> None:
    space, world = config.space("G1"), AnalyticWorld()
    assert "centred" in config.samplers
    for name in config.samplers:
        sampler = instantiate(config.samplers[name], _partial_=True, _convert_="all")(
            space=space, seed=1
        )
        for _ in range(3):
            points = sampler.ask()
            assert space.violation(points) is None, name
            tests = [space.decode(point) for point in points]
            signals = [run_test(world, VisiblePixelOracle(), CAR, test).signals for test in tests]
            sampler.tell(
                points, np.array([kpi.evaluate(columns, 0.1).adj_ttc_s for columns in signals])
            )


def test_a_concrete_scenario_that_breaks_a_clause_is_refused_by_name(
    config: Config, tests: pd.DataFrame
) -> None:
    space = config.space("G1")
    with pytest.raises(InputError) as caught:
        concrete_scenario(space, ["animation=crouching"])
    broken = (
        "breaks the constraint 'animation != crouching or pedestrian_speed = 0': "
        "pedestrian_speed = 1.4, animation = crouching"
    )
    assert str(caught.value) == f"the scenario {broken}"
    assert (
        concrete_scenario(space, ["animation=crouching", "pedestrian_speed=0.5"])["animation"]
        == "crouching"
    )
    tests = tests.copy()
    tests.loc[3, ["animation", "pedestrian_speed"]] = ["crouching", 1.4]
    with pytest.raises(InputError) as caught:
        encode_tests(tests, space)
    assert str(caught.value) == f"test G1-pairwise-base-0-00003 {broken}; make the campaign again"


def test_a_strategy_is_found_by_laws_and_by_the_configuration(conf: Path, config: Config) -> None:
    assert set(strategies(conf)) - set(strategies()) == {"centred"}
    assert config.samplers["centred"] == {"_target_": "own_strategies.Centred", "batch_size": 8}
    check_sampler(lambda: strategies(conf)["centred"](CONSTRAINED, 5), CONSTRAINED)
    chosen = compose(
        "smoke",
        ["strategies=[random,centred]", "arms.adaptive=centred", "+samplers.centred.hurry=2"],
    )
    assert chosen.samplers["centred"]["hurry"] == 2
    with pytest.raises(
        InputError, match="unknown key 'samplers.centred.hury'; did you mean 'hurry'?"
    ):
        compose("smoke", ["+samplers.centred.hury=2"])
