"""Two runs in one folder wait for each other."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
from pathlib import Path
from select import select
from types import SimpleNamespace
from typing import Any

import pytest

from pipeline.artefacts.run_lock import HELD, hold
from pipeline.workflow.guards import alone
from tests.studies import ROOT

HOLD = """
import sys
from pipeline.artefacts.run_lock import hold
hold(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""

STARTS = """
import subprocess, sys
from pathlib import Path
from types import SimpleNamespace
from pipeline.commands import test_detector as command
waits = [sys.executable, "-c", "import sys; print('started', flush=True); sys.stdin.read()"]
command.subprocess = SimpleNamespace(run=lambda words, **options: subprocess.run(waits, **options))
command.check = lambda *_: None
Path("a.onnx").touch()
command.run(SimpleNamespace(words=["a.onnx"], study="default", calibrate=False, cores=1))
"""
"""`test-detector` with a process in Snakemake's place."""


def run(folder: Path, name: str, script: str = HOLD) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, "-c", script, name], cwd=folder, env=environment, text=True, **PIPES
    )


PIPES: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)


def test_the_second_says_who_is_at_work_and_goes_on_when_the_first_is_killed(
    tmp_path: Path,
) -> None:
    first = run(tmp_path, "snakemake")
    assert first.stdout is not None and first.stdout.readline() == "held\n"
    second = run(tmp_path, "test-detector")
    assert second.stderr is not None and second.stdout is not None
    message = f"blindspot: snakemake (process {first.pid}) is running in this folder"
    assert second.stderr.readline() == f"{message}; waiting for it to finish\n"
    first.kill()
    assert second.stdout.readline() == "held\n"
    second.communicate("")


def test_the_snakemake_of_a_killed_test_detector_keeps_others_out(tmp_path: Path) -> None:
    (tmp_path / "models").symlink_to(ROOT / "models")
    first = run(tmp_path, "", STARTS)
    assert (
        first.stdout is not None
        and first.stdin is not None
        and first.stdout.readline() == "started\n"
    )
    second = run(tmp_path, "snakemake")
    assert second.stderr is not None and second.stdout is not None
    assert second.stderr.readline().startswith(
        f"blindspot: test-detector (process {first.pid}) is running in this folder; waiting"
    )
    first.kill()
    first.wait()
    assert not select([second.stdout], [], [], 1)[0], "Snakemake is at work"
    first.stdin.close()
    assert second.stdout.readline() == "held\n"
    second.communicate("")


def test_a_disk_without_locks_does_not_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(file: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(HELD, "")
    monkeypatch.setattr(fcntl, "flock", refuse)
    (handle,) = hold("test-detector")
    os.close(handle)
    assert (tmp_path / ".cache/run.lock").read_text() == f"test-detector (process {os.getpid()})\n"


def snakemake(**changes: Any) -> Any:
    """As much of a Snakemake workflow that executes jobs as counts here."""
    return SimpleNamespace(
        **{"is_main_process": True, "executor_plugin": "local", "dryrun": False, **changes}
    )


@pytest.mark.parametrize(
    "waits_not", [{"dryrun": True}, {"executor_plugin": None}, {"is_main_process": False}]
)
def test_only_a_snakemake_that_executes_holds_the_folder(
    waits_not: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(HELD, "")
    left = tmp_path / ".snakemake/locks/0.input.lock"
    left.parent.mkdir(parents=True)
    left.touch()
    alone(snakemake(**waits_not))
    assert left.exists() and not (tmp_path / ".cache").exists()
    alone(snakemake())
    assert (
        not left.exists()
        and (tmp_path / ".cache/run.lock").read_text() == f"snakemake (process {os.getpid()})\n"
    )
