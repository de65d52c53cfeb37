"""`replay` executes a test again and says whether it ends as recorded."""

from __future__ import annotations

import shutil
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from pipeline.__main__ import main
from pipeline.artefacts.recorded_tests import params_of
from pipeline.artefacts.tables import read_tests, write_tests
from pipeline.config.composing import PARAMS, dump, functional_scenario, load, validate
from tests.studies import StudyFolder

CAMPAIGN: dict[str, Any] = {
    "kind": "campaigns",
    "scenario": "F1",
    "strategy": "random",
    "version": "base",
    "seed": 0,
}
TEST = "F1-random-base-0-00002"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    study = StudyFolder.composed(
        tmp_path_factory.mktemp("study"),
        "smoke",
        ["simulator=analytic", "detector=oracle", "campaign.tests=4", "seeds=[0]"],
    )
    assert study.run("define-space", scenario="F1") == 0
    (study / "models/base").mkdir(parents=True)
    (study / "models/base/model.onnx").write_bytes(b"the oracle needs none")
    assert study.run("campaign", **CAMPAIGN) == 0
    return study


def table(study: StudyFolder) -> Path:
    return study / "/".join(map(str, CAMPAIGN.values())) / "tests.parquet"


def replay(study: StudyFolder, test: str = TEST) -> int:
    with chdir(study.root):
        return main(["replay", test])


def test_a_test_ends_as_recorded(study: StudyFolder, capsys: pytest.CaptureFixture[str]) -> None:
    assert replay(study) == 0
    assert capsys.readouterr().out.endswith("s, as recorded\n")
    assert (study.root / "replay.mp4").stat().st_size > 1000


def test_another_outcome_is_told(study: StudyFolder, capsys: pytest.CaptureFixture[str]) -> None:
    rows, space = read_tests(table(study)), functional_scenario("F1").logical_space()
    table(study).with_name("tests.parquet.stamp").unlink()
    write_tests(table(study), rows.assign(false_positives=7), space)
    assert replay(study) == 1
    assert "false_positives 0 instead of 7" in capsys.readouterr().out
    write_tests(table(study), rows, space)


def test_the_study_that_has_a_test_is_found(
    study: StudyFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    # The second study has the campaign as the audit beside its searches.
    params_files = [
        study.root / "data" / name / "params.yaml" for name in ("best-7692c3ad", "best-f0e1d2c3")
    ]
    campaigns = zip(
        params_files,
        ("campaigns/F1/random/best/0", "campaigns/audit/F1/random/best/0"),
        ("random", "mixed"),
        strict=True,
    )
    for params, folder, strategy in campaigns:
        (params.parent / folder).mkdir(parents=True)
        shutil.copy(table(study), params.parent / folder)
        named = {
            "study": params.parent.name,
            "goal": "detectors",
            "tested": {"best": "best.onnx"},
            "strategies": [strategy],
        }
        changed = validate(
            {**load(study.root / PARAMS).model_dump(mode="json"), **named}, "the test"
        )
        params.write_text(dump(changed, "test-detector"))
        with chdir(study.root):
            assert params_of("F1-random-best-0-00001", PARAMS) == params.relative_to(study.root)
            assert params_of(TEST, PARAMS) == PARAMS
        params.rename(params.with_suffix(".held"))
    (study.root / "data/broken").mkdir()
    (study.root / "data/broken/params.yaml").write_text("study: [")
    for params in params_files:
        params.with_suffix(".held").rename(params)
    assert replay(study, "F1-random-best-0-00001") == 2
    message = (
        "; choose its study: --params data/best-7692c3ad/params.yaml or "
        "data/best-f0e1d2c3/params.yaml\n"
    )
    assert capsys.readouterr().err.endswith(
        f"study smoke has no campaign 'F1-random-best-0'{message}"
    )
    # Also where the study in params.yaml has executed nothing.
    held = table(study).rename(table(study).with_suffix(".held"))
    assert replay(study, "F1-random-best-0-00001") == 2
    assert capsys.readouterr().err.endswith(message)
    assert replay(study, TEST) == 2
    assert "study smoke has no executed campaign here" in capsys.readouterr().err
    held.rename(table(study))


@pytest.mark.parametrize(
    ("test", "message"),
    [
        (
            "F1-random-base-0-00009",
            "has the tests F1-random-base-0-00000 to F1-random-base-0-00003, got "
            "F1-random-base-0-00009",
        ),
        ("nope", "expected a test such as F1-forest-base-0-00012, got 'nope'"),
        (
            "F1-radom-base-0-00001",
            "study smoke has no campaign 'F1-radom-base-0'; did you mean 'F1-random-base-0'?",
        ),
    ],
)
def test_unknown_tests_are_named(
    study: StudyFolder, capsys: pytest.CaptureFixture[str], test: str, message: str
) -> None:
    assert replay(study, test) == 2
    assert message in capsys.readouterr().err
