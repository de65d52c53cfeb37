"""The schema of the configuration refuses what is wrong, by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.__main__ import main
from pipeline.config import CONF, compose, dump, load
from pipeline.protocols import InputError

STUDIES = sorted(path.stem for path in (CONF / "study").glob("*.yaml"))


@pytest.mark.parametrize("study", STUDIES)
def test_every_study_composes_and_survives_its_file(study: str, tmp_path: Path) -> None:
    config = compose(study, [])
    path = tmp_path / "params.yaml"
    path.write_text(dump(config, "test"))
    assert load(path) == config
    assert config.study == study


@pytest.mark.parametrize("group", ["detector", "simulator"])
def test_every_choice_of_a_group_composes(group: str) -> None:
    for path in (CONF / group).glob("*.yaml"):
        assert getattr(compose("smoke", [f"{group}={path.stem}"]), group)["_target_"]


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("campaign.testss=3", "unknown key 'campaign.testss'; did you mean 'tests'?"),
        ("+campaign.testss=3", "unknown key 'campaign.testss'; did you mean 'tests'?"),
        ("campaign.tests=0", "campaign.tests: Input should be greater than or equal to 1, got 0"),
        ("strategies=[random,neurl]", "strategies: there is no 'neurl'; did you mean 'neural'?"),
        ("adaptive=pairwise", "adaptive: there is no 'pairwise'"),
        ("held_out=[F1]", "held_out must not be searched: F1 is in both lists"),
        ("scenarios.F1.space.fog.low=200", "scenarios.F1.space: variable 'fog': low must be below high, got 200"),
        ("scenarios.F1.ego.speed_kmh=-3", "scenarios.F1.ego.speed_kmh: Input should be greater than 0, got -3"),
        ("+samplers.neural.explor=0.1", "unknown key 'samplers.neural.explor'; did you mean 'explore'?"),
        ("samplers.neural._target_=pipeline.nowhere.Sampler", "samplers.neural._target_: there is no 'pipeline.nowhere.Sampler'"),
        ("base_set.validation_share=1.5", "base_set.validation_share: Input should be less than 0.9, got 1.5"),
    ],
)
def test_wrong_input_is_named(override: str, message: str) -> None:
    with pytest.raises(InputError, match=".*") as caught:
        compose("default", [override])
    assert message in str(caught.value)


def test_an_unknown_study_names_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compose", "study=defualt"]) == 2
    assert "there is no study 'defualt'; did you mean 'default'?" in capsys.readouterr().err


def test_a_missing_params_file_says_how_to_make_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = tmp_path / "params.yaml"
    assert main(["define-space", "--scenario", "F1", "--out", str(tmp_path / "x.json"), "--params", str(missing)]) == 2
    assert "compose study=default" in capsys.readouterr().err
