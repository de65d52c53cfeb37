"""dvc.yaml covers every study of the loop: its files, what they are made from, and no cycle."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.config.composing import compose, dump
from pipeline.contract import STAMP
from pipeline.workflow.jobs import STAGES, Jobs, step_names
from tests.studies import ROOT

PARTS: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
MOST_LINES = 150
STUDY = "data/${study}"
VARIANTS = (
    ["retraining.rounds=2"],
    [
        "base.source=trained",
        "retraining.start=scratch",
        "comparison.second_iou=0.3",
        "+arms.fresh=new_scenes",
    ],
)
"""Overrides that together read and write every file of a study."""


def default_jobs(*overrides: str) -> Jobs:
    return Jobs(compose("default", list(overrides)), step_names())


def outputs_of(stage: dict[str, Any]) -> set[str]:
    """All paths that a stage records."""
    paths: set[str] = set()
    for kind in ("outs", "metrics", "plots"):
        for entry in stage.get(kind, ()):
            paths |= set(entry)
    return paths


def recorded_path(jobs: Jobs, path: str) -> str:
    """The path that DVC records for a file: the study's top file or folder, or another folder."""
    root = f"{jobs.folders.root}/"
    if path.startswith(root):
        return f"{STUDY}/{path.removeprefix(root).split('/')[0]}"
    assert Path(path).parent == Path(jobs.config.base.weights)
    return "${base.weights}"


def test_the_file_is_short() -> None:
    assert len((ROOT / "dvc.yaml").read_text().splitlines()) <= MOST_LINES


def test_a_stage_is_a_part_that_snakemake_makes_from_all_code_and_parameters() -> None:
    assert list(PARTS) == list(STAGES)
    for name, stage in PARTS.items():
        assert stage["cmd"] == f"snakemake {name}"
        assert stage["deps"][0] == "pipeline" and stage["params"] == [{"params.yaml": None}]


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_lists_what_its_jobs_read_and_write(name: str) -> None:
    reads, writes = {"pipeline"}, set()
    for overrides in VARIANTS:
        jobs = default_jobs(*overrides)
        for target, paths in jobs.parts[name]:
            reads |= {recorded_path(jobs, path) for path in jobs.inputs(target)}
            writes |= {recorded_path(jobs, path) for path in paths}
    assert outputs_of(PARTS[name]) == writes
    assert set(PARTS[name]["deps"]) == reads - writes


def test_outputs_persist() -> None:
    for stage in PARTS.values():
        for kind in ("outs", "metrics", "plots"):
            for entry in stage.get(kind, ()):
                assert [options["persist"] for options in entry.values()] == [True]


def test_every_file_of_a_study_is_recorded() -> None:
    recorded = {path for stage in PARTS.values() for path in outputs_of(stage)}
    jobs = default_jobs("retraining.rounds=2")
    written = {recorded_path(jobs, path) for _, paths in jobs.in_order() for path in paths}
    assert recorded == written
    assert f"{STUDY}/report.html.{STAMP}" in recorded


def test_every_step_of_the_loop_is_in_a_stage() -> None:
    steps = {job.step for jobs in default_jobs(*VARIANTS[1]).parts.values() for job, _ in jobs}
    other_studies = {"export", "calibrate", "detector_report", "shard"}
    loop = {name for name in step_names() if not name.startswith("front_car")} - other_studies
    assert steps == loop


def test_a_stage_named_after_a_step_records_only_what_its_one_job_makes() -> None:
    for name, jobs in default_jobs().parts.items():
        if name in step_names():
            assert [(target.step, target.wildcards) for target, _ in jobs] == [(name, ())], (
                f"`snakemake {name}` makes no other job's files"
            )


def test_dvc_would_run_the_first_stages_of_a_small_study(tmp_path: Path) -> None:
    shutil.copy(ROOT / "dvc.yaml", tmp_path)
    (tmp_path / "params.yaml").write_text(dump(compose("smoke", []), "test"))
    (tmp_path / "pipeline").mkdir()

    def dvc(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "dvc", *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout

    dvc("init", "--no-scm", "--quiet")
    graph = dvc("dag", "--dot")
    assert '"search" -> "analysis";' in graph and '"compare" -> "track";' in graph
    planned = dvc("repro", "--dry", "spaces", "base_set")
    assert "> snakemake spaces" in planned and "> snakemake base_set" in planned
