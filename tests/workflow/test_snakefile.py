"""The workflow plans every study, and reruns exactly what a changed line concerns."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from snakemake.settings.types import DAGSettings

from pipeline import versioning, workflow
from pipeline.__main__ import STEPS
from pipeline.config.composing import CONF, compose, dump
from pipeline.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
STUDIES = sorted(path.stem for path in (CONF / "study").glob("*.yaml"))


def copy(folder: Path) -> Path:
    """A copy of what the workflow needs."""
    for name in ("pipeline", "conf", "profiles", "models"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("Snakefile", "front_car.smk"):
        shutil.copy(ROOT / name, folder)
    return folder


def snakemake(folder: Path, *arguments: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(folder), "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    command = [sys.executable, "-m", "snakemake", "--cores", "2", *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("study", STUDIES)
def test_every_study_plans(study: str, tmp_path: Path) -> None:
    folder = copy(tmp_path)
    (folder / "params.yaml").write_text(dump(compose(study, []), "test"))
    planned = snakemake(folder, "-n")
    assert ("render_base" in planned) == (study != "front_car")
    assert ("rule report:" in planned or "rule front_car_report:" in planned) == (study != "base")


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ("tests: eighty", "params.yaml: campaign.tests: Input should be a valid integer"),
        ("tests: [40", "params.yaml, line"),
        (None, "params.yaml: no such file; make it by `python -m pipeline compose study=default`"),
    ],
)
def test_what_is_wrong_in_params_is_told_in_one_line(wrong: str | None, told: str, tmp_path: Path) -> None:
    folder = copy(tmp_path)
    if wrong is not None:
        text = dump(compose("smoke", ["campaign.tests=40"]), "test")
        assert "tests: 40" in text
        (folder / "params.yaml").write_text(text.replace("tests: 40", wrong))
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "-n"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    (line,) = [line for line in done.stderr.splitlines() if "profile" not in line]
    assert done.returncode == 2 and line.startswith(f"error: {told}")


def test_the_graph_is_drawn(tmp_path: Path) -> None:
    folder = copy(tmp_path)
    (folder / "params.yaml").write_text(dump(compose("smoke", []), "test"))
    assert "digraph" in snakemake(folder, "--dag")


def test_sources_follow_the_imports() -> None:
    cluster = workflow.sources("pipeline.steps.cluster")
    assert "pipeline/core/regions.py" in cluster and "pipeline/steps/cluster.py" in cluster
    assert "pipeline/detectors/yolo/loss.py" not in cluster
    assert "pipeline/report/page.html.jinja" in workflow.sources("pipeline.steps.report")
    assert "pipeline/detectors/yolo/loss.py" in workflow.sources("pipeline.steps.retrain")


def test_what_a_changed_key_makes_stale(tmp_path: Path) -> None:
    def stamps(*overrides: str) -> tuple[str, str, str, int]:
        (tmp_path / "params.yaml").write_text(dump(compose("default", list(overrides)), "test"))
        study = workflow.Study(tmp_path / "params.yaml")
        search, held_out = (study.stamp("campaign", *study.campaign_sections(name)) for name in ("F1", "F1star"))
        return search, held_out, study.stamp("retrain", *study.retraining_sections), study.training_seed("adaptive")

    search, held_out, retraining, seed = stamps()
    # One more round or seed leaves the versions that there are as they are; another first seed does not.
    assert stamps("retraining.rounds=3", "retraining.seeds=[0,1]") == (search, held_out, retraining, seed)
    assert stamps("retraining.seeds=[7]") == (search, held_out, retraining, 7)
    assert stamps("retraining.iterations=7")[2] != retraining
    # What a failure is, all executions are judged by; the size of the search is none of the comparison's.
    threshold, tests = stamps("campaign.failure_threshold_s=0.2"), stamps("campaign.tests=7")
    assert threshold[0] != search and threshold[1] != held_out
    assert tests[0] != search and tests[1] == held_out


def test_only_a_whole_run_tells_its_verdict_and_dvc(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "params.yaml").write_text(dump(compose("default", []), "test"))
    study = workflow.Study(tmp_path / "params.yaml")
    told: list[list[str]] = []
    monkeypatch.setattr(workflow.subprocess, "run", lambda command, **_: told.append(command) or subprocess.CompletedProcess(command, 0))
    monkeypatch.setattr(workflow, "ROOT", tmp_path)
    for part in ({"targets": {"search"}}, {"targets": {study.goals[0]}}, {"until": {"compare"}}, {"omit_from": {"report"}}):
        study.finish(DAGSettings(**{name: frozenset(values) for name, values in part.items()}))
    assert not told
    for whole in ((), ("all",), study.goals):
        study.finish(DAGSettings(targets=list(whole)))  # As Snakemake's command line gives them.
    for stage in ("search", "track"):
        monkeypatch.setenv("DVC_STAGE", stage)
        study.finish(DAGSettings(targets=[stage]))
    assert [command[3] for command in told] == ["verdict"] * 4


def test_a_search_that_keeps_no_frame_is_refused_before_it_begins(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text(dump(compose("default", ["campaign.keep_every=0"]), "test"))
    with pytest.raises(InputError, match=r"campaign\.keep_every must be at least 1, or no frame is left to learn from, got 0"):
        workflow.Study(tmp_path / "params.yaml")


def test_a_changed_line_makes_exactly_its_steps_stale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = copy(tmp_path)
    before = {step: _digest(folder, step, monkeypatch) for step in STEPS}
    source = folder / "pipeline" / "core" / "rules.py"
    source.write_text(source.read_text() + "\n# changed\n")
    after = {step: _digest(folder, step, monkeypatch) for step in STEPS}
    assert [step for step in STEPS if before[step] != after[step]] == ["cluster", "retrain", "compare"]


def _digest(folder: Path, step: str, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(workflow, "ROOT", folder)
    workflow.code_digest.cache_clear()
    found = workflow.code_digest(f"pipeline.steps.{step.replace('-', '_')}")
    workflow.code_digest.cache_clear()
    return found


def test_dvc_yaml_is_what_the_code_says() -> None:
    assert (ROOT / "dvc.yaml").read_text() == versioning.text(), "make dvc.yaml again: python -m pipeline.versioning"


def test_a_round_learns_from_all_campaigns_before_it(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text(dump(compose("smoke", ["retraining.rounds=2", "retraining.seeds=[0,4]"]), "test"))
    study = workflow.Study(tmp_path / "params.yaml")
    adaptive, random = (study.added("adaptive-r2-s4", source) for source in ("adaptive", "random"))
    assert adaptive["filters"] == ["data/smoke/filter/neural.csv", "data/smoke/retrained/filter/neural/adaptive-s4.csv"]
    assert random["filters"] == ["data/smoke/filter/random.csv", "data/smoke/retrained/filter/random/random-s4.csv"]
    assert "data/smoke/retrained/campaigns/F2/neural/adaptive-s4/0/frames.parquet" in adaptive["frames"]
    assert study.added("control-r2", "random") == {"filters": [], "frames": []}
    assert study.parent("adaptive-r2-s4", "model.json") == "data/smoke/retrained/models/adaptive-s4/model.json"
    later = study.later_search("tests.parquet")
    assert "data/smoke/retrained/campaigns/F2/random/random/0/tests.parquet" in later and len(set(later)) == len(later) == 4 * 2
    assert "rounds.png" in " ".join(study.plots) and len(study.models("model.json")) == 13
    planned = snakemake(_with(tmp_path), "-n")
    assert "filter_round" in planned and "random-r2-s4" in planned


def test_a_campaign_waits_for_those_that_it_learns_from(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text(dump(compose("retraining", ["search=[F1,F2,F5]"]), "test"))
    study = workflow.Study(tmp_path / "params.yaml")
    known = study.earlier("campaigns", "F5", "neural", "base", "0")
    assert known == [f"data/retraining/campaigns/{name}/neural/base/0/tests.parquet" for name in ("F1", "F2")]
    assert study.earlier("retrained/campaigns", "F2", "neural", "adaptive", "0")[0].startswith("data/retraining/retrained/campaigns/F1/")
    assert not study.earlier("campaigns", "F5", "random", "base", "0") and not study.earlier("held_out", "F1star", "neural", "base", "0")


def test_every_version_executes_the_sequences_of_one_seed(tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text(dump(compose("retraining", ["comparison.seed=3"]), "test"))
    paths = [Path(path) for path in workflow.Study(tmp_path / "params.yaml").held_out("tests.parquet")]
    seeds = {(path.parts[-5], path.parts[-2]) for path in paths}
    assert len(paths) == 40 and seeds == {(f"F{i}star", "3") for i in range(1, 5)}


def _with(folder: Path) -> Path:
    params = (folder / "params.yaml").read_bytes()
    copy(folder)
    (folder / "params.yaml").write_bytes(params)
    return folder
