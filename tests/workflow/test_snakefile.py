"""The workflow plans every study, and runs again exactly the jobs that a changed line concerns."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from snakemake.settings.types import DAGSettings

from pipeline import sources
from pipeline.artefacts.files import sha256
from pipeline.artefacts.stamp_parts import remember
from pipeline.artefacts.stamps import Stamp
from pipeline.config.composing import CONF, compose, dump
from pipeline.config.schema import Config
from pipeline.errors import InputError
from pipeline.report.catalogue import CATEGORIES, COMPARISON, DETECTOR, PAGES, SEARCH, entry
from pipeline.workflow import staleness, stamping
from pipeline.workflow.jobs import Jobs, Target, flat, step_names
from pipeline.workflow.plan import Plan
from pipeline.workflow.staleness import Staleness
from pipeline.workflow.stamping import Stamps
from tests.studies import ROOT, fill_cache
from tests.warm_python import snakemake

STUDIES = sorted(path.stem for path in (CONF / "study").glob("*.yaml"))
CAMPAIGN = {
    "kind": "campaigns",
    "scenario": "F1",
    "strategy": "random",
    "version": "base",
    "seed": "0",
}


def copy(folder: Path, config: Config) -> Path:
    """A copy of the workflow's files, with a study's params.yaml."""
    for name in ("pipeline", "conf", "profiles", "models"):
        shutil.copytree(
            ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    shutil.copy(ROOT / "Snakefile", folder)
    (folder / "params.yaml").write_text(dump(config, "test"))
    fill_cache(folder)
    return folder


def planned(folder: Path, *words: str) -> dict[str, int]:
    """Number of jobs of each rule that Snakemake would run."""
    done = snakemake(folder, "-n", *words)
    assert done.returncode == 0, done.stderr
    table = re.search(
        r"Job stats:\njob +count\n[- ]+\n(.*?)\ntotal", done.stdout + done.stderr, re.DOTALL
    )
    rows = [] if table is None else table[1].splitlines()
    return {name: int(count) for name, count in map(str.split, rows)}


def jobs_of(study: str, *overrides: str) -> Jobs:
    return Jobs(compose(study, list(overrides)), step_names())


def today(*overrides: str) -> Stamps:
    """The stamps of the default study."""
    return Stamps(jobs_of("default", *overrides))


@pytest.mark.parametrize("study", STUDIES)
def test_every_study_plans(study: str, tmp_path: Path) -> None:
    config = compose(study, [])
    jobs = planned(copy(tmp_path, config))
    last = {
        "report": "report",
        "base": "train",
        "front_car": "front_car_report",
        "detectors": "detector_report",
    }
    assert last[config.goal] in jobs
    assert ("render_base" in jobs) == (config.goal in ("report", "base"))
    assert ("export" in jobs) == (study == "published")


def test_the_stages_of_dvc_make_the_whole_study(tmp_path: Path) -> None:
    folder = copy(tmp_path, compose("default", []))
    commands = [
        stage["cmd"].split()
        for stage in yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"].values()
    ]
    assert {program for program, _ in commands} == {"snakemake"}
    by_stage, whole = planned(folder, *(target for _, target in commands)), planned(folder)
    assert {name: by_stage.get(name) for name in step_names() if name in whole} == {
        n: c for n, c in whole.items() if n != "all"
    }


def test_the_snakefile_lists_every_step() -> None:
    listed = re.findall(r'^ +"(\w+)",', (ROOT / "Snakefile").read_text(), re.MULTILINE)
    assert sorted(listed) == list(step_names())


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("tests: eighty", "params.yaml: campaign.tests: expected a whole number"),
        ("tests: [40", "params.yaml, line"),
        (
            None,
            "params.yaml: no such file in {folder}; make it with `python -m pipeline compose "
            "study=default`",
        ),
    ],
)
def test_an_error_in_params_is_one_line(wrong: str | None, message: str, tmp_path: Path) -> None:
    folder = copy(tmp_path, compose("smoke", ["campaign.tests=40"]))
    params = folder / "params.yaml"
    assert "tests: 40" in params.read_text()
    if wrong is None:
        params.unlink()
    else:
        params.write_text(params.read_text().replace("tests: 40", wrong))
    done = snakemake(folder, "-n")
    (line,) = [line for line in done.stderr.splitlines() if "profile" not in line]
    assert done.returncode == 2 and line.startswith(f"error: {message.format(folder=folder)}")


def test_the_command_line_of_snakemake_does_not_change_the_study(tmp_path: Path) -> None:
    folder = copy(tmp_path, compose("smoke", []))
    other = tmp_path / "data/smoke/other.yaml"
    other.parent.mkdir(parents=True)
    other.write_text(dump(compose("smoke", ["seeds=[0,1,2]"]), "test"))
    for words in (["--configfile", str(other)], ["--config", "seeds=[0,1]"]):
        done = snakemake(folder, "-n", *words)
        (line,) = [line for line in done.stderr.splitlines() if "profile" not in line]
        assert done.returncode == 2
        assert line.startswith(
            f"error: {words[0]} would change only a part of the study; type: python -m pipeline "
            "compose study=NAME"
        )
    # test-detector names a study by the file in the study's folder.
    params_file = other.with_name("params.yaml")
    other.rename(params_file)
    assert planned(folder, "search", "--configfile", str(params_file))["campaign"] == 12
    params_file.write_text(params_file.read_text() + "study: smoke\n")
    done = snakemake(folder, "-n", "--configfile", str(params_file))
    (line,) = [line for line in done.stderr.splitlines() if "profile" not in line]
    assert done.returncode == 2
    assert re.match(
        r"error: .*data/smoke/params\.yaml, line \d+: not valid YAML \(the key 'study' appears "
        r"twice",
        line,
    )


def test_snakemake_runs_by_its_path_from_anywhere(tmp_path: Path) -> None:
    folder = copy(tmp_path, compose("smoke", []))
    command = [str(Path(sys.executable).with_name("snakemake")), "spaces"]
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), "PYTHONPATH": str(folder)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(list((folder / "data/smoke/space").glob("*.json"))) == 3


@pytest.mark.parametrize(
    ("limit", "left"), [([], False), (["--max-jobs-per-timespan", "50/1s"], True)]
)
def test_jobs_leave_no_timers_behind_unless_the_user_limits_them(
    limit: list[str], left: bool, tmp_path: Path
) -> None:
    folder = copy(tmp_path, compose("smoke", []))
    timers = "sum(isinstance(thread, threading.Timer) for thread in threading.enumerate())"
    with open(folder / "Snakefile", "a") as stream:
        stream.write(f"\n\nonsuccess:\n    import threading\n    print(f'timers: {{{timers}}}')\n")
    done = snakemake(folder, "spaces", *limit)
    (count,) = re.findall(r"timers: (\d+)", done.stdout)
    assert (int(count) > 0) == left


def test_the_graph_is_drawn(tmp_path: Path) -> None:
    assert "digraph" in snakemake(copy(tmp_path, compose("smoke", [])), "--dag").stdout


def test_stamps_decide_what_runs_again(tmp_path: Path) -> None:
    folder = copy(tmp_path, compose("smoke", []))
    assert planned(folder, "spaces") == {"spaces": 1, "define_space": 3}
    assert snakemake(folder, "spaces").returncode == 0
    assert planned(folder, "spaces") == {}
    # A clone with pulled outputs: no records of Snakemake, and times in any order.
    shutil.rmtree(folder / ".snakemake")
    for age_s, path in enumerate(sorted((folder / "data/smoke/space").iterdir())):
        os.utime(path, (10**9 - age_s, 10**9 - age_s))
    assert planned(folder, "spaces") == {}
    source = folder / "pipeline" / "steps" / "define_space.py"
    text = source.read_text()
    source.write_text(text + "\n# changed\n")
    assert planned(folder, "spaces") == {"spaces": 1, "define_space": 3}
    source.write_text(text)
    assert planned(folder, "spaces") == {}
    scenario = compose("smoke", ["scenarios.F2.label=another"])
    (folder / "params.yaml").write_text(dump(scenario, "test"))
    assert planned(folder, "spaces") == {"spaces": 1, "define_space": 1}


def test_a_job_that_outlives_its_snakemake_is_not_done_again(tmp_path: Path) -> None:
    folder = copy(tmp_path, compose("smoke", []))
    words = [sys.executable, "-m", "snakemake", "--cores", "1", "spaces"]
    first = subprocess.Popen(
        words, cwd=folder, env={**os.environ, "PYTHONPATH": str(folder)}, stderr=subprocess.DEVNULL
    )
    awaited(folder / ".snakemake/scripts", "*.py")
    time.sleep(0.3)  # The job has begun; it takes a second to import.
    first.kill()
    first.wait()
    awaited(folder / "data/smoke/space", "*.stamp")
    assert planned(folder, "spaces") == {"spaces": 1, "define_space": 2}


def awaited(folder: Path, pattern: str) -> None:
    """Wait until a folder holds such a file."""
    until = time.monotonic() + 60
    while not any(folder.glob(pattern)):
        assert time.monotonic() < until
        time.sleep(0.01)


def test_the_order_of_variables_counts_because_it_determines_the_tests() -> None:
    config = compose("default", [])
    plain = json.loads(config.model_dump_json())
    plain["scenarios"]["F1"]["space"] = dict(reversed(plain["scenarios"]["F1"]["space"].items()))
    other = Config.model_validate_json(json.dumps(plain))
    first, second = (
        Stamps(Jobs(variant, step_names())).stamp("define_space", {"scenario": "F1"})
        for variant in (config, other)
    )
    assert first != second and config.space("F1") != other.space("F1")


def made(folder: Path, config: Config) -> Jobs:
    """The jobs of a study of which every file is there, with the stamps of its config."""
    study = Jobs(config, step_names())
    stamps = Stamps(study)
    for target, outputs in study.in_order():
        for path in (folder / output for output in outputs if not output.endswith("/")):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(
                Stamp(stamps.stamp(target.step, dict(target.wildcards))).text()
                if path.suffix == ".stamp"
                else "content"
            )
        for path in (folder / output for output in outputs if output.endswith("/")):
            path.mkdir(parents=True, exist_ok=True)
    return study


def test_a_stale_job_takes_all_jobs_after_it_along(tmp_path: Path) -> None:
    folder = copy(tmp_path, compose("smoke", []))
    made(folder, compose("smoke", []))
    assert planned(folder) == {}
    (folder / "data/smoke/regions/base/F1.json.stamp").unlink()
    assert planned(folder) == {
        "cluster": 1,
        "compare": 1,
        "report": 1,
        "evidence": 1,
        "track": 1,
        "all": 1,
    }
    (folder / "params.yaml").write_text(dump(compose("smoke", ["base_set.seed=5"]), "test"))
    jobs = planned(folder)
    after = {
        "train",
        "campaign",
        "measure",
        "cluster",
        "filter",
        "white_box",
        "retrain",
        "second_iou",
        "compare",
        "report",
        "evidence",
        "track",
    }
    assert set(jobs) == {"render_base", "all"} | after and jobs["campaign"] == 8


def test_files_asked_for_by_name_may_have_any_reasons(tmp_path: Path) -> None:
    """While it plans, Snakemake lists a folder once: a reason written into it later would be a
    missing input."""
    folder = copy(tmp_path, compose("smoke", []))
    assert snakemake(folder, "spaces").returncode == 0
    changed = compose("smoke", ["scenarios.F1.label=one", "scenarios.F2.label=two"])
    (folder / "params.yaml").write_text(dump(changed, "test"))
    assert planned(folder, "data/smoke/space/F1.json", "data/smoke/space/F2.json") == {
        "define_space": 2
    }


def test_the_reason_of_a_job_names_what_changed(tmp_path: Path) -> None:
    folder = copy(tmp_path, compose("smoke", []))
    assert snakemake(folder, "spaces").returncode == 0

    def reasons_shown() -> str:
        done = snakemake(folder, "-n", "spaces")
        reasons = re.findall(r"reason: (.*)", done.stdout + done.stderr)
        return "\n".join(dict.fromkeys(line for line in reasons if ".snakemake/changed" in line))

    (folder / "params.yaml").write_text(
        dump(compose("smoke", ["scenarios.F2.label=another"]), "test")
    )
    assert (
        reasons_shown()
        == "Updated input files: .snakemake/changed/define_space/F2/scenarios.F2.label"
    )
    (folder / "params.yaml").write_text(dump(compose("smoke", []), "test"))
    source = folder / "pipeline" / "steps" / "define_space.py"
    source.write_text(source.read_text() + "\n# changed\n")
    of_code = reasons_shown()
    assert all(
        f".snakemake/changed/define_space/{name}/pipeline_steps_define_space.py" in of_code
        for name in ("F1", "F1star", "F2")
    )
    (folder / "data/smoke/space/F1.json.stamp").unlink()
    assert ".snakemake/changed/define_space/F1/no_stamp" in reasons_shown()
    # The cache of parts is lost.
    shutil.rmtree(folder / ".cache/stamps")
    assert ".snakemake/changed/define_space/F2/other_settings_or_code" in reasons_shown()


def test_the_reason_of_a_later_job_is_the_key_that_changed_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for path in ("models",):
        (tmp_path / path).symlink_to(ROOT / path)
    made(tmp_path, compose("smoke", []))
    changed = Staleness(Stamps(jobs_of("smoke", "campaign.tests=13", "retraining.iterations=9")))
    assert changed.reasons(Target("measure", ())) == ("campaign.tests",)
    assert set(changed.reasons(Target("report", ()))) == {"campaign.tests", "retraining.iterations"}


@pytest.mark.parametrize(
    "named", ["{}/mine.onnx", "../mine.onnx", "{}/" + 60 * "deep/" + "mine.onnx"]
)
def test_a_reason_never_replaces_the_file_that_it_names(
    named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = tmp_path / "project"
    project.mkdir()
    monkeypatch.chdir(project)
    (project / "models").symlink_to(ROOT / "models")
    mine = Path(named.format(tmp_path))
    mine.parent.mkdir(parents=True, exist_ok=True)
    mine.write_text("before")
    study = made(project, compose("smoke", ["goal=detectors", f"+tested.mine={mine}"]))
    mine.write_text("after")
    marks = Staleness(Stamps(study)).marks(Target.of("campaign", {**CAMPAIGN, "version": "mine"}))[
        "changed"
    ]
    assert mine.read_text() == "after"
    folder = Path(".snakemake/changed/campaign/campaigns/F1/0/random/mine")
    assert [Path(mark).parent for mark in marks] == [folder] and marks[0].endswith("mine.onnx")


@pytest.mark.parametrize("name", ["", ".", "..", "/", "../.."])
def test_a_reason_without_a_readable_name_is_a_file_too(name: str) -> None:
    assert staleness.file_name(name) == "an_input"


def test_every_page_and_plot_has_a_category_and_a_caption() -> None:
    """Of every study; and no caption is left over."""
    used = set()
    for study in STUDIES:
        jobs = jobs_of(study)
        paths = [
            path for step in jobs.contracts.values() for path in flat(step.outputs(jobs.folders))
        ]
        used |= {entry(path) for path in paths if path.endswith((".html", ".png"))}
    for listed in used:
        assert (ROOT / "pipeline/rules" / listed.caption).read_text().strip().endswith(".")
    kinds = {listed.kind for listed in used}
    # Only studies of several rounds have the plot `rounds`.
    assert (
        kinds | {"rounds"}
        == set(CATEGORIES)
        == {path.stem for path in (ROOT / "pipeline/rules/captions").iterdir()}
    )


def test_snakemake_reports_with_captions_and_categories(tmp_path: Path) -> None:
    folder = copy(tmp_path, compose("smoke", []))
    made(folder, compose("smoke", []))
    done = snakemake(folder, "--report", "report.html")
    assert done.returncode == 0, done.stderr
    text = (folder / "report.html").read_text()
    assert all(f'"{category}"' in text for category in (PAGES, SEARCH, COMPARISON, DETECTOR))
    assert "Failures found after each test of the search" in text and "evidence/base.html" in text


def test_what_was_made_for_other_settings_in_between_does_not_count(tmp_path: Path) -> None:
    """As after `git checkout` and `dvc checkout`: Snakemake's records name the other settings."""
    first, other = compose("smoke", []), compose("smoke", ["scenarios.F2.label=another"])
    folder = copy(tmp_path, first)
    assert snakemake(folder, "spaces").returncode == 0
    shutil.copytree(folder / "data", tmp_path / "first")
    (folder / "params.yaml").write_text(dump(other, "test"))
    assert snakemake(folder, "spaces").returncode == 0
    shutil.rmtree(folder / "data")
    shutil.copytree(tmp_path / "first", folder / "data")
    (folder / "params.yaml").write_text(dump(first, "test"))
    assert planned(folder, "spaces") == {}


def test_the_same_reason_twice_makes_a_job_again_twice(tmp_path: Path) -> None:
    """Snakemake records the checksums of inputs, and the file that stands for a reason is one."""
    folder = copy(tmp_path, compose("smoke", []))
    assert snakemake(folder, "spaces").returncode == 0
    for label in ("second", "third"):
        (folder / "params.yaml").write_text(
            dump(compose("smoke", [f"scenarios.F2.label={label}"]), "test")
        )
        assert planned(folder, "spaces")["define_space"] == 1
        assert snakemake(folder, "spaces").returncode == 0
        assert planned(folder, "spaces") == {}


def test_sources_follow_the_imports() -> None:
    cluster = sources.sources("pipeline.steps.cluster")
    assert "pipeline/core/regions.py" in cluster and "pipeline/steps/cluster.py" in cluster
    assert "pipeline/detectors/yolo/loss.py" not in cluster
    page = {
        "page.html.jinja",
        "assets/explorer.js",
        "assets/explorer.css",
        "assets/libraries.min.js",
        "assets/libraries.css",
    }
    assert {f"pipeline/report/{name}" for name in page} <= set(
        sources.sources("pipeline.steps.report")
    )
    # Importing a module runs the packages above it, which import others.
    drawn = {
        "pipeline/__init__.py",
        "pipeline/simulators/mujoco/__init__.py",
        "pipeline/simulators/gl.py",
    }
    assert drawn <= set(sources.sources("pipeline.simulators.mujoco.vehicles"))
    assert "pipeline/detectors/yolo/loss.py" in sources.sources("pipeline.steps.retrain")


def test_what_a_changed_key_makes_stale() -> None:
    def stamps(*overrides: str) -> dict[str, str]:
        today_stamps = today(*overrides)
        held_out = {**CAMPAIGN, "kind": "held_out", "scenario": "F1star", "strategy": "pairwise"}
        jobs = {
            "search": ("campaign", CAMPAIGN),
            "held_out": ("campaign", held_out),
            "version": ("retrain", {"version": "adaptive"}),
        }
        return {name: today_stamps.stamp(*job) for name, job in jobs.items()}

    first = stamps()
    # One more round or seed leaves the present versions unchanged; another first seed does not.
    assert stamps("retraining.rounds=3", "retraining.seeds=[0,1]") == first
    assert (
        stamps("retraining.seeds=[7]")
        == {**first, "version": stamps("retraining.seeds=[7]")["version"]}
        != first
    )
    assert stamps("retraining.iterations=7")["version"] != first["version"]
    # The failure threshold concerns all executions, the size of the search not the comparison.
    threshold, tests = stamps("campaign.failure_threshold_s=0.2"), stamps("campaign.tests=7")
    assert threshold["search"] != first["search"] and threshold["held_out"] != first["held_out"]
    assert tests["search"] != first["search"] and tests["held_out"] == first["held_out"]


def test_a_newly_held_out_town_is_checked_again() -> None:
    first, other = today(), today("held_out=[F1star,F2star]")
    for step, wildcards in (
        ("render_base", {}),
        ("train", {}),
        ("retrain", {"version": "control"}),
    ):
        assert first.stamp(step, wildcards) != other.stamp(step, wildcards), step


def test_a_persons_changed_table_makes_the_filter_and_the_versions_that_learn_from_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")

    def stamps(row: str) -> dict[Target, str]:
        Path("mine.csv").write_text(f"test_id,step,keep\n{row}")
        today_stamps = Stamps(
            Jobs(compose("default", []).model_copy(update={"filter": OVERRULED}), step_names())
        )
        return {
            job: today_stamps.stamp(job.step, dict(job.wildcards))
            for job, _ in today_stamps.jobs.in_order()
        }

    first, other = stamps(""), stamps("F1-random-base-0-00001,0,false\n")
    changed = {job for job in first if first[job] != other[job]}
    assert {job.step for job in changed if dict(job.wildcards).get("version") == "base"} == {
        "filter"
    }
    assert {dict(job.wildcards)["version"] for job in changed if job.step == "retrain"} == {
        "random",
        "adaptive",
    }


OVERRULED = compose("default", []).filter.model_copy(update={"overrules": "mine.csv"})


def test_another_tracking_server_is_sent_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    before = today().stamp("track", {})
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:5001")
    assert today().stamp("track", {}) != before


def test_a_step_depends_on_the_stamps_of_its_inputs() -> None:
    first, other = today(), today("base_set.seed=5")
    assert first.stamp("train", {}) != other.stamp("train", {})
    assert first.stamp("measure", {}) != other.stamp("measure", {})
    assert first.stamp("define_space", {"scenario": "F1"}) == other.stamp(
        "define_space", {"scenario": "F1"}
    )


def test_a_changed_file_in_a_detectors_folder_makes_its_campaigns_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    read: list[Path] = []

    def noted(path: Path) -> str:
        read.append(path)
        return sha256(path)

    monkeypatch.setattr(stamping, "sha256", noted)

    def stamps(weights: str) -> set[str]:
        (mine / "model.safetensors").write_text(weights)
        today_stamps = today("goal=detectors", f"+tested.mine={mine}")
        return {
            today_stamps.stamp("campaign", {**CAMPAIGN, "version": "mine", "seed": seed})
            for seed in ("0", "1")
        }

    first = stamps("first")
    assert read == [mine], "two jobs read the folder"
    assert first.isdisjoint(stamps("second")) and stamps("first") == first


def test_only_a_whole_run_prints_its_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    study = Plan(jobs_of("default"), Path("data/mine/params.yaml"))
    calls: list[list[str]] = []
    monkeypatch.setattr(subprocess, "run", lambda command, **_: calls.append(command))
    for part in (
        {"targets": {"search"}},
        {"targets": {study.jobs.folders.goals[0]}},
        {"until": {"compare"}},
        {"omit_from": {"report"}},
    ):
        study.finish(DAGSettings(**{name: frozenset(values) for name, values in part.items()}))
    assert not calls
    for whole in ((), ("all",), study.jobs.folders.goals, ("track",)):
        study.finish(DAGSettings(targets=list(whole)))  # As Snakemake's command line passes them.
    assert [command[3:] for command in calls] == [
        ["verdict", "--params", "data/mine/params.yaml"]
    ] * 4
    monkeypatch.setenv("BLINDSPOT_VERDICT_FOLLOWS", "1")
    study.finish(DAGSettings())
    assert len(calls) == 4


def test_a_search_without_kept_frames_is_refused_at_the_start() -> None:
    with pytest.raises(
        InputError,
        match=r"^campaign\.keep_every must be at least 1, got 0: "
        r"no frame would be left to train on$",
    ):
        jobs_of("default", "campaign.keep_every=0")


def test_a_cache_that_cannot_be_written_stops_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = sources.sources("pipeline.errors")
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".cache").symlink_to("/nowhere/cache")
    monkeypatch.setattr(sources, "stored_digests", dict)
    assert list(sources.source_digests.__wrapped__("pipeline.errors")) == list(paths)
    remember("a digest", {"a part": "another"})


def test_no_sign_in_a_text_hides_code() -> None:
    code = "x = 1\ny = '\u2028'\n\x0cz = 2\nw = 3\n"
    text = "'''A module.'''\n" + code.replace("1", "1  # Why.").replace(
        "z = 2", "z = 2\n'''Of z.'''"
    )
    assert sources.code_of("module.py", text.encode()).decode() == code


def test_a_changed_line_makes_exactly_its_steps_stale_but_no_comment_or_docstring(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copy(tmp_path, compose("smoke", []))

    def digests() -> dict[str, str]:
        for stored in (sources.code_digest, sources.source_digests, sources.stored_digests):
            stored.cache_clear()
        return {step: sources.code_digest(f"pipeline.steps.{step}") for step in step_names()}

    monkeypatch.setattr(sources, "ROOT", folder)
    monkeypatch.setattr(sources, "STORED", tmp_path / "code.json")
    before = digests()
    source = folder / "pipeline" / "core" / "rules.py"
    text = source.read_text()
    source.write_text(text.replace("as np\n", "as np  # Why.\n# More.\n", 1) + "    # changed\n")
    commented = digests()
    source.write_text(text.replace('"""', '"""Another\n', 1))
    documented = digests()
    source.write_text(text + "\nCHANGED = '# no comment'\n")
    after = digests()
    digests()
    assert commented == documented == before
    assert [step for step in before if before[step] != after[step]] == [
        "cluster",
        "compare",
        "evidence",
        "retrain",
    ]


def test_a_round_learns_from_all_campaigns_before_it(tmp_path: Path) -> None:
    config = compose("smoke", ["retraining.rounds=2", "retraining.seeds=[0,4]"])
    folders = Jobs(config, step_names()).folders
    filters = {
        source: folders.added_filters("adaptive-r2-s4", source) for source in ("adaptive", "random")
    }
    assert filters["adaptive"] == [
        "data/smoke/filter/mixed/base.csv",
        "data/smoke/retrained/filter/mixed/adaptive-s4.csv",
    ]
    assert filters["random"] == [
        "data/smoke/filter/random/base.csv",
        "data/smoke/retrained/filter/random/random-s4.csv",
    ]
    frames = folders.added("adaptive-r2-s4", "adaptive", "frames.parquet")
    assert "data/smoke/retrained/campaigns/F2/mixed/adaptive-s4/0/frames.parquet" in frames
    own_searches = jobs_of(
        "smoke",
        "retraining.rounds=2",
        "seeds=[0,4]",
        "retraining.seeds=[0,4]",
        "retraining.searches=own",
    )
    root, alone = (
        "data/smoke/retrained/campaigns",
        own_searches.folders.added("adaptive-r2-s4", "adaptive", "frames.parquet"),
    )
    assert {path.split("/")[-2] for path in alone} == {
        "4"
    } and f"{root}/F2/mixed/adaptive-s4/4/frames.parquet" in alone
    assert [path.split("/")[-3:-1] for path in own_searches.folders.later_searches[:2]] == [
        ["random", "0"],
        ["random", "0"],
    ]
    assert (
        folders.parent("adaptive-r2-s4", "model.json")
        == "data/smoke/retrained/models/adaptive-s4/model.json"
    )
    later = folders.later_searches
    assert (
        "data/smoke/retrained/campaigns/F2/random/random/0/tests.parquet" in later
        and len(set(later)) == len(later) == 4 * 2
    )
    assert "rounds.png" in " ".join(folders.plots) and len(folders.models("model.json")) == 13
    jobs = planned(copy(tmp_path, config))
    assert (jobs["filter"], jobs["retrain"]) == (6, 12)


def test_a_campaign_waits_for_the_campaigns_that_it_learns_from() -> None:
    folders = jobs_of("retraining", "search=[F1,F2,F5]", "campaign.transfer=[mixed]").folders
    key = {
        "kind": "campaigns",
        "scenario": "F5",
        "strategy": "mixed",
        "version": "base",
        "seed": "0",
    }
    assert folders.earlier(**key) == [
        f"data/retraining/campaigns/{name}/mixed/base/0/tests.parquet" for name in ("F1", "F2")
    ]
    later = folders.earlier(
        **key | {"kind": "retrained/campaigns", "scenario": "F2", "version": "adaptive"}
    )
    assert later[0].startswith("data/retraining/retrained/campaigns/F1/")
    assert not folders.earlier(**key | {"strategy": "random"}) and not folders.earlier(
        **key | {"kind": "held_out", "scenario": "F1star"}
    )


def test_every_version_executes_the_sequences_of_one_seed() -> None:
    paths = [
        Path(path)
        for path in jobs_of("retraining", "comparison.seed=3").folders.held_out("tests.parquet")
    ]
    seeds = {(path.parts[-5], path.parts[-2]) for path in paths}
    assert len(paths) == 6 * 9 and seeds == {(f"F{i}star", "3") for i in range(1, 7)}
