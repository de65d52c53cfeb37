"""The generated files in the repository match the code and conf/."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from pipeline.__main__ import main
from pipeline.commands import reference, stages
from pipeline.config.composing import PARAMS, compose, load
from pipeline.workflow.jobs import Jobs, step_names

ROOT = Path(__file__).resolve().parents[2]


def test_params_match_the_command_in_their_first_line() -> None:
    command = PARAMS.read_text().splitlines()[0].split("`")[1]
    study, *overrides = command.partition(" compose study=")[2].split()
    assert load(PARAMS) == compose(study, overrides), (
        f"conf/ has changed since; compose again: {command}"
    )


def test_the_reference_is_up_to_date() -> None:
    stale = [
        name
        for name, page in reference.PAGES.items()
        if (ROOT / reference.FOLDER / name).read_text() != page()
    ]
    assert not stale, "make docs/reference again: python -m pipeline reference"


def test_a_stale_page_is_named_and_made_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["reference", "--out", str(tmp_path)]) == 0
        and main(["reference", "--out", str(tmp_path), "--check"]) == 0
    )
    (tmp_path / "columns.md").write_text("older")
    assert main(["reference", "--out", str(tmp_path), "--check"]) == 1
    assert f"{tmp_path / 'columns.md'}: out of date" in capsys.readouterr().err
    assert (tmp_path / "columns.md").read_text() == "older"


def test_dvc_yaml_matches_the_contracts() -> None:
    assert (ROOT / "dvc.yaml").read_text() == stages.text(), (
        "make dvc.yaml again: python -m pipeline stages"
    )


def test_every_step_of_the_loop_is_in_a_stage_of_dvc() -> None:
    stages_ = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"].values()
    listed = {
        Path(path).stem
        for stage in stages_
        for path in stage["deps"]
        if path.startswith("pipeline/steps/")
    }
    loop = {name for name in step_names() if not name.startswith("front_car")} - {
        "export",
        "calibrate",
        "detector_report",
    }
    assert loop <= listed


def test_a_stage_named_after_a_step_records_only_what_its_one_job_makes() -> None:
    for name, jobs in Jobs(compose("default", []), step_names()).parts.items():
        if name in step_names():
            assert [(target.step, target.wildcards) for target, _ in jobs] == [(name, ())], (
                f"`snakemake {name}` makes no other job's files"
            )


def test_the_stage_of_the_base_depends_on_the_detector_of_any_study() -> None:
    listed = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]["base"]["deps"]
    assert [path for path in listed if not path.startswith(("pipeline/", "data/"))] == [
        "${base.weights}"
    ]


@pytest.mark.parametrize("stage", ["search", "versions", "held_out"])
def test_a_stage_depends_on_the_code_that_its_config_names(stage: str) -> None:
    listed = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"][stage]["deps"]
    config = compose("default", [])
    named = [config.simulator, config.detector, *config.samplers.values()]
    assert {
        section["_target_"].rpartition(".")[0].replace(".", "/") + ".py" for section in named
    } <= set(listed)


def test_dvc_records_every_file_of_a_study_with_its_stamp() -> None:
    stages_ = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"].values()
    recorded = {
        path
        for stage in stages_
        for kind in ("outs", "metrics", "plots")
        for out in stage.get(kind, ())
        for path in out
    }
    jobs = Jobs(compose("default", ["retraining.rounds=2"]), step_names())
    made = {path.split("/")[2] for _, outputs in jobs.in_order() for path in outputs}
    assert {path.removeprefix("data/${study}/") for path in recorded} == made
