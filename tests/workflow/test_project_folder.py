"""Commands find their project from any folder, and read paths as the person typed them."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import chdir
from pathlib import Path

import pytest

from pipeline.__main__ import main
from pipeline.config import project
from pipeline.config.composing import load
from pipeline.config.project import CHECKOUT, entered, project_of, typed
from tests.studies import StudyFolder


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    folder = StudyFolder.composed(tmp_path_factory.mktemp("study"), "smoke")
    (folder / "reports").mkdir(parents=True)
    return folder


@pytest.fixture
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder without a project around it, and an installed package without a checkout."""
    monkeypatch.setattr(project, "CHECKOUT", tmp_path / "site-packages")
    return tmp_path


def test_the_nearest_project_counts(study: StudyFolder, nowhere: Path) -> None:
    assert project_of(study / "reports") == study.root == project_of(study.root)
    checkout = nowhere / "checkout"
    (checkout / "pipeline").mkdir(parents=True)
    (checkout / "Snakefile").touch()
    (checkout / "data/mine-1234").mkdir(parents=True)
    (checkout / "data/mine-1234/params.yaml").touch()  # As test-detector writes it.
    assert project_of(checkout / "data/mine-1234") == checkout
    assert project_of(nowhere) == nowhere


def test_elsewhere_an_editable_installation_uses_its_checkout(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert project_of(tmp_path) == CHECKOUT
    with chdir(tmp_path), entered():
        assert Path.cwd() == CHECKOUT and typed("film.mp4") == tmp_path / "film.mp4"
    assert (
        capsys.readouterr().err
        == f"blindspot: no project in {tmp_path} or above; using {CHECKOUT}\n"
    )


def test_typed_paths_belong_to_the_folder_of_the_person(study: StudyFolder) -> None:
    with chdir(study / "reports"), entered():
        assert Path.cwd() == study.root
        assert typed("mine.csv") == study / "reports/mine.csv" and typed("/mine.csv") == Path(
            "/mine.csv"
        )
    with chdir(study.root), entered():
        assert typed("mine.csv") == Path("mine.csv")


def test_a_command_in_a_subfolder_works_on_the_study(
    study: StudyFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    with chdir(study / "reports"):
        assert (
            main(["compose", "study=smoke", "campaign.tests=14", "base.weights=models/uniform"])
            == 0
        )
        assert (
            main(["compose", "study=smoke", "base.weights=models/uniform", "--out", "mine.yaml"])
            == 0
        )
        assert main(["step", "define-space", "--scenario", "F1"]) == 0
        assert main(["verify"]) == 0
        assert main(["verdict"]) == 2
    assert load(study.root / "params.yaml").campaign.tests == 14
    assert (study / "space/F1.json").is_file() and (study / "reports/mine.yaml").is_file()
    assert "data/smoke/comparison.json: expected a readable file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["verdict"], "params.yaml: no such file in {folder}; make it with"),
        (
            ["replay", "F1-random-base-0-00001"],
            "params.yaml: no such file in {folder}; make it with",
        ),
        (["versions"], "{folder}/data/mlflow/mlflow.db: expected MLflow's database, found no file"),
    ],
)
def test_without_a_project_the_folder_is_named(
    words: list[str], message: str, nowhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with chdir(nowhere):
        assert main(words) == 2
    printed = capsys.readouterr().err
    assert message.format(folder=nowhere) in printed and printed.count("\n") == 1


def test_the_program_starts_in_a_subfolder(study: StudyFolder) -> None:
    command = [sys.executable, "-m", "pipeline", "verify"]
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT)}
    done = subprocess.run(
        command, cwd=study / "reports", env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
