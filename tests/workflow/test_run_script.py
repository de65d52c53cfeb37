"""`./run` and `.ci/run`, as far as they can be tested without an installation."""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import signal
import stat
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
SETUP = ("run", "pyproject.toml", "requirements.lock")
QUIET = "pipeline/no_telemetry.env"


def call(folder: Path, *arguments: str, **settings: str) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": "/usr/bin:/bin", "HOME": "/nonexistent", **settings}
    return subprocess.run(
        [folder / "run", *arguments],
        cwd="/",
        env=environment,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )


def script(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def fit_python(folder: Path, text: str) -> None:
    """Write a stand-in for the Python of a checkout.

    It answers questions about its version and OpenGL, and otherwise runs the text.
    """
    answers = 'case "$*" in -c*) exit ;; -V) echo Python 3.11.2; exit ;;'
    opengl = '"-m pipeline.simulators.gl") echo egl; exit ;; esac'
    script(folder / ".venv/bin/python", f"{answers} {opengl}\n{text}")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout with only the files of the setup."""
    (tmp_path / "pipeline").mkdir()
    for name in (*SETUP, QUIET):
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


@pytest.fixture
def ready(checkout: Path) -> Path:
    """A checkout after setup, with a stand-in for snakemake that prints its call."""
    stamp = hashlib.sha256(
        b"".join((checkout / name).read_bytes() for name in SETUP[1:])
    ).hexdigest()
    script(
        checkout / ".venv/bin/snakemake",
        'echo "snakemake $*"; echo "HOME of caches: $XDG_CACHE_HOME"; exit "${CODE:-0}"',
    )
    fit_python(checkout, 'echo "python $*"')
    script(
        checkout / ".venv/bin/pip", f'exec "{checkout}/.venv/bin/python" "$0" "$@"'
    )  # As pip writes it for a path with spaces.
    script(checkout / ".venv/bin/dvc", 'echo "dvc $*"')
    (checkout / ".venv/blindspot.stamp").write_text(f"{stamp}  - {checkout}\n")
    (checkout / ".venv/blindspot.build").write_text("cpu\n")
    (checkout / ".cache").mkdir()
    return checkout


@pytest.mark.parametrize("name", ["run", ".ci/run"])
def test_the_scripts_are_valid_bash(name: str) -> None:
    assert (ROOT / name).stat().st_mode & stat.S_IXUSR
    assert subprocess.run(["bash", "-n", ROOT / name]).returncode == 0


def test_help_needs_no_setup(checkout: Path) -> None:
    done = call(checkout, "--help")
    assert done.returncode == 0
    assert all(f"./run {word}" in done.stdout for word in ("setup", "test", "ui"))
    assert not (checkout / ".venv").exists()


@pytest.mark.parametrize("state", ["checkout", "ready"])
def test_an_unfit_python_ends_with_one_message(state: str, request: pytest.FixtureRequest) -> None:
    done = call(request.getfixturevalue(state), "setup", PYTHON="/nonexistent/python3.9")
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "blindspot: needs Python 3.11 to 3.13, found /nonexistent/python3.9; type: sudo apt-get "
        "install -y python3 python3-venv"
    ]


def limited(folder: Path, limit: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-c", f"ulimit {limit}; ./run"], cwd=folder, capture_output=True, text=True
    )


def test_a_machine_without_room_rights_or_handles_is_named_before_any_work(checkout: Path) -> None:
    done = limited(checkout, "-n 100")
    assert (done.returncode, done.stderr) == (
        2,
        "blindspot: needs 256 file handles, the limit is 100; type: ulimit -n 1024\n",
    )
    done = limited(checkout, "-f 8")  # A file may not grow, as on a full disk.
    assert done.returncode == 2 and done.stderr.startswith(
        f"blindspot: cannot write in {checkout}: "
    )
    assert not list((checkout / ".cache").glob("room*"))
    shutil.rmtree(checkout / ".cache")
    (checkout / ".cache").write_text("in the way")
    done = limited(checkout, "-n 1024")
    assert done.returncode == 2
    assert (
        done.stderr
        == f"blindspot: cannot write in {checkout}: File exists; the same command resumes once it "
        "can\n"
    )


def test_the_pages_need_tracked_runs(checkout: Path) -> None:
    done = call(checkout, "ui")
    assert done.returncode == 2
    assert "nothing is tracked yet" in done.stderr


def test_a_ready_checkout_installs_nothing_and_passes_its_arguments_on(ready: Path) -> None:
    done = call(ready, "-n", "some/target", CORES="3")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "snakemake --cores 3 -n some/target",
        f"HOME of caches: {ready}/.cache",
    ]


@pytest.mark.parametrize(
    ("words", "started"),
    [
        (["setup"], ""),
        (["test", "-k", "x"], "python -m pytest -k x"),
        (["explore", "--port", "1"], "python -m pipeline explore --port 1"),
        (
            ["ui", "--workers", "1"],
            "mlflow ui --backend-store-uri sqlite:///data/mlflow/mlflow.db --host 127.0.0.1 "
            "--port 5000 --workers 1",
        ),
    ],
)
def test_each_word_starts_its_command(words: list[str], started: str, ready: Path) -> None:
    script(ready / ".venv/bin/mlflow", 'echo "mlflow $*"')
    (ready / "data/mlflow").mkdir(parents=True)
    (ready / "data/mlflow/mlflow.db").touch()
    done = call(ready, *words)
    assert (done.returncode, done.stdout.strip()) == (0, started)
    assert f"./run {words[0]}" in call(ready, "--help").stdout


def test_what_run_starts_reports_nothing(ready: Path) -> None:
    script(ready / ".venv/bin/snakemake", "env")
    set_ = [line for line in (ROOT / QUIET).read_text().splitlines() if not line.startswith("#")]
    assert set_ and set(set_) <= set(call(ready, "-n").stdout.splitlines())


@pytest.fixture
def finished(ready: Path) -> Path:
    """A checkout with a finished study of two jobs that DVC has not recorded."""
    (ready / "data/tiny/space").mkdir(parents=True)
    for name in ("tracking.json.stamp", "space/F1.json.stamp"):
        (ready / "data/tiny" / name).write_text("one")
    (ready / ".dvc").mkdir()
    (ready / "dvc.yaml").write_text("")
    (ready / "params.yaml").write_text("study: tiny\ngoal: report\n")
    return ready


COMMIT, VERDICT = "dvc commit --force --quiet", "python -m pipeline verdict"


def test_a_whole_run_ends_with_the_verdict_and_is_recorded_once(finished: Path) -> None:
    assert [call(finished).stdout.splitlines()[3:] for _ in range(2)] == [
        [VERDICT, COMMIT],
        [VERDICT],
    ]
    # The job that comes last gave the same file, but another one did not: timings differ.
    (finished / "data/tiny/space/F1.json.stamp").write_text("another")
    assert call(finished).stdout.splitlines()[-1] == COMMIT
    (finished / "dvc.lock").write_text("of another revision")
    assert call(finished).stdout.splitlines()[-1] == COMMIT
    (finished / "params.yaml").write_text("study: tiny\ngoal: base\n")
    assert call(finished).stdout.splitlines()[-1] == VERDICT


@pytest.mark.parametrize("name", ["123", "on", "null"])
def test_a_study_may_have_a_name_that_yaml_quotes(name: str, finished: Path) -> None:
    (finished / "data/tiny").rename(finished / "data" / name)
    (finished / "params.yaml").write_text(yaml.safe_dump({"study": name, "goal": "report"}))
    done = call(finished)
    assert (done.returncode, done.stderr, done.stdout.splitlines()[3:]) == (
        0,
        "",
        [VERDICT, COMMIT],
    )
    assert call(finished).stdout.splitlines()[3:] == [VERDICT]


@pytest.mark.parametrize(
    ("program", "text"),
    [("python", 'case "$3" in verdict) kill -9 $PPID;; esac'), ("dvc", "kill -9 $PPID")],
)
def test_a_run_that_is_killed_at_its_end_is_finished_by_the_next(
    finished: Path, program: str, text: str
) -> None:
    whole = (finished / ".venv/bin" / program).read_text()
    script(finished / ".venv/bin" / program, text)
    assert call(finished).returncode == -9
    (finished / ".venv/bin" / program).write_text(whole)
    assert [call(finished).stdout.splitlines()[3:] for _ in range(2)] == [
        [VERDICT, COMMIT],
        [VERDICT],
    ]


@pytest.mark.parametrize(("text", "stays"), [("{}", True), ('{"write"', False), ("", False)])
def test_a_part_of_the_locks_of_dvc_is_removed(finished: Path, text: str, stays: bool) -> None:
    locks = finished / ".dvc/tmp/rwlock"
    locks.parent.mkdir()
    locks.write_text(text)
    assert call(finished).stdout.splitlines()[-1] == COMMIT
    assert locks.exists() == stays


def test_damaged_files_are_found_before_the_run_that_makes_them_again(finished: Path) -> None:
    for code, begins, ends in ((1, ["python", "snakemake"], 0), (2, ["python"], 2)):
        fit_python(finished, f'echo "python $*"; case "$3" in verify) exit {code};; esac')
        done = call(finished)
        lines = done.stdout.splitlines()
        assert (
            lines[0] == "python -m pipeline verify --params params.yaml"
            and [line.split()[0] for line in lines[:2]] == begins
        )
        assert done.returncode == ends


@pytest.mark.parametrize(
    "words", [["--configfile", "data/x/params.yaml"], ["--configfile=data/x/params.yaml", "search"]]
)
def test_a_run_of_another_study_verifies_that_one(words: list[str], ready: Path) -> None:
    assert (
        call(ready, *words).stdout.splitlines()[0]
        == "python -m pipeline verify --params data/x/params.yaml"
    )


def test_a_partial_run_prints_no_verdict(ready: Path) -> None:
    assert [line.split()[0] for line in call(ready, "search").stdout.splitlines()] == [
        "python",
        "snakemake",
        "HOME",
    ]


@pytest.mark.parametrize(
    "words", [["-n"], ["search", "-np"], ["--dry-run"], ["--dryrun", "search"]]
)
def test_a_dry_run_does_not_wait(ready: Path, words: list[str]) -> None:
    with (ready / ".cache/run.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = call(ready, *words, CORES="2")
    assert done.returncode == 0 and done.stdout.startswith(
        f"snakemake --cores 2 {' '.join(words)}\n"
    )


def test_ctrl_c_ends_with_one_sentence_that_says_what_goes_on(ready: Path) -> None:
    script(
        ready / ".venv/bin/snakemake",
        "touch begun; trap 'exit 1' INT; while :; do sleep 0.05; done",
    )
    run = subprocess.Popen(
        [ready / "run"],
        env={"PATH": "/usr/bin:/bin"},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not (ready / "begun").exists():
        assert run.poll() is None
    os.killpg(run.pid, signal.SIGINT)
    printed = run.communicate(timeout=30)[1]
    assert (
        printed
        == "blindspot: stopped; finished jobs and tests are kept, and the same command resumes\n"
    )
    assert run.returncode == 130


def test_the_exit_code_is_that_of_snakemake(ready: Path) -> None:
    assert call(ready, CODE="7").returncode == 7


def test_a_second_run_waits_for_the_first(ready: Path) -> None:
    script(
        ready / ".venv/bin/snakemake",
        'echo begin >>calls; while [ ! -e "$PWD/go" ]; do sleep 0.05; done; echo end >>calls',
    )
    environment = {"PATH": "/usr/bin:/bin"}
    first = subprocess.Popen([ready / "run"], env=environment)
    while not (ready / "calls").exists():
        assert first.poll() is None
    second = subprocess.Popen([ready / "run"], env=environment, stderr=subprocess.PIPE, text=True)
    assert second.stderr is not None
    assert (
        second.stderr.readline()
        == f"blindspot: ./run (process {first.pid}) is running in this folder; waiting for it to "
        "finish\n"
    )
    (ready / "go").write_text("")
    assert (first.wait(), second.wait()) == (0, 0)
    assert (ready / "calls").read_text().split() == ["begin", "end", "begin", "end"]


def test_a_disk_without_locks_does_not_lock(ready: Path, tmp_path: Path) -> None:
    script(tmp_path / "bin/flock", "echo 'No locks available' >&2; exit 69")
    done = call(ready, PATH=f"{tmp_path}/bin:/usr/bin:/bin")
    assert done.returncode == 0 and "snakemake" in done.stdout and not done.stderr


def opengl(folder: Path, text: str) -> None:
    """A stand-in for the Python of a checkout whose probe of OpenGL runs the text."""
    fit_python(folder, 'echo "python $*"')
    python = (folder / ".venv/bin/python").read_text()
    script(folder / ".venv/bin/python", python.replace("echo egl; exit", text, 1))


def test_without_root_a_missing_library_gives_one_command_to_type(ready: Path) -> None:
    opengl(ready, "echo libegl1 libgl1-mesa-dri; echo 'blindspot: no OpenGL' >&2; exit 3")
    script(ready / "user/id", "echo 1000")
    done = call(ready, "-n", PATH=f"{ready}/user:/usr/bin:/bin")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines() == [
        "blindspot: missing system packages: libegl1 libgl1-mesa-dri; "
        "type: sudo apt-get install -y --no-install-recommends libegl1 libgl1-mesa-dri"
    ]


def test_a_missing_library_is_installed_and_tried_again(ready: Path) -> None:
    opengl(ready, "echo libegl1; [ -e installed ] && exit; exit 3")
    script(ready / "user/id", "echo 0")
    script(
        ready / "user/apt-get", 'echo "apt-get $*" >>calls; [ "$1" = update ] || touch installed'
    )
    done = call(ready, "-n", PATH=f"{ready}/user:/usr/bin:/bin")
    assert (done.returncode, done.stderr) == (0, "blindspot: installing libegl1\n")
    assert (ready / "calls").read_text().splitlines()[1].endswith(" libegl1")
    opengl(ready, "echo libegl1; echo 'blindspot: no display' >&2; exit 3")
    done = call(ready, "-n", PATH=f"{ready}/user:/usr/bin:/bin")
    assert done.returncode == 2
    assert done.stderr.splitlines()[1:] == [
        "blindspot: OpenGL still does not work with libegl1:",
        "blindspot: no display",
    ]


def test_a_faulty_program_is_not_reported_as_a_missing_library(ready: Path) -> None:
    opengl(ready, "echo 'ModuleNotFoundError: mujoco' >&2; exit 1")
    done = call(ready, "-n")
    assert done.returncode == 2
    assert done.stderr == "ModuleNotFoundError: mujoco\n"


def installing(checkout: Path, cpu_builds: bool, **settings: str) -> list[str]:
    """The calls of uv in a set-up, then its messages.

    Args:
        checkout: the folder to set up.
        cpu_builds: whether the CPU builds of PyTorch can be reached.
        settings: environment variables.
    """
    uv = 'echo "uv $(echo "$*" | grep -oE -e "--torch-backend cpu.*|torch===.*|-e .*")" >>calls'
    refused = "" if cpu_builds else '; case "$*" in *torch-backend*) exit 1 ;; esac'
    script(checkout / ".venv/bin/uv", uv + refused)
    fit_python(checkout, 'case "$*" in *config*) exit 1 ;; esac')
    script(checkout / ".venv/bin/pip", f'exec "{checkout}/.venv/bin/python" "$0" "$@"')
    (checkout / "calls").unlink(missing_ok=True)
    done = call(checkout, "setup", **settings)
    assert done.returncode == 0, done.stderr
    lines = (checkout / "calls").read_text().splitlines() if (checkout / "calls").exists() else []
    return [*lines, *done.stderr.splitlines()]


def test_without_an_nvidia_gpu_the_cpu_build_is_installed(checkout: Path) -> None:
    version = re.search(r"^torch==([^ ]+)", (checkout / "requirements.lock").read_text(), re.M)
    assert version
    cpu, cuda = f"uv --torch-backend cpu torch=={version[1]}", f"torch==={version[1]} -e .[dev]"
    lines = installing(checkout, cpu_builds=True)
    assert lines[:2] == [cpu, "uv -e .[dev]"] and "PyTorch's CPU build (a few" in lines[2]
    shutil.rmtree(checkout / ".venv")
    lines = installing(checkout, cpu_builds=False)
    assert lines[:2] == [cpu, "uv -e .[dev]"] and "CPU build cannot be downloaded" in lines[3]
    # The stand-in for PyTorch prints no version of CUDA, which reads as a CUDA build: it stays.
    assert installing(checkout, cpu_builds=True) == ["blindspot: ready"]
    (checkout / ".venv/blindspot.build").write_text("cpu\n")
    assert installing(checkout, cpu_builds=True) == ["blindspot: ready"]
    lines = installing(checkout, cpu_builds=True, CUDA="1")
    assert lines[0] == f"uv {cuda}" and "PyTorch's CUDA build" in lines[1]
    (checkout / ".venv/blindspot.build").write_text("cpu\n")
    script(checkout / "gpu/nvidia-smi", "")
    lines = installing(checkout, cpu_builds=True, PATH=f"{checkout}/gpu:/usr/bin:/bin")
    assert lines[0] == f"uv {cuda}"


def test_cuda_is_1_or_unset(ready: Path) -> None:
    done = call(ready, "setup", CUDA="yes")
    assert (done.returncode, done.stderr) == (2, "blindspot: CUDA must be 1 or unset, got 'yes'\n")


@pytest.mark.parametrize("opens", [True, False])
def test_without_a_browser_its_tests_are_left_out_and_named(opens: bool, ready: Path) -> None:
    fit_python(
        ready, f'case "$*" in *tests.browser) exit {int(not opens)} ;; esac; echo "python $*"'
    )
    script(ready / "user/id", "echo 1000")
    done = call(ready, "test", PATH=f"{ready}/user:/usr/bin:/bin")
    parallel = f"-n {len(os.sched_getaffinity(0)) + 1} --dist loadfile"
    if opens:
        assert (done.stdout, done.stderr) == (f"python -m pytest {parallel}\n", "")
    else:
        assert done.stdout == f"python -m pytest -m not browser {parallel}\n"
        assert "left out" in done.stderr and "chromium libatomic1" in done.stderr
