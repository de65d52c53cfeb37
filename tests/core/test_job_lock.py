"""One process at a time holds a lock, and a killed one holds none."""

from __future__ import annotations

import fcntl
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.artefacts.job_lock import held

HOLDER = """
import sys, time
from pathlib import Path
from pipeline.artefacts.job_lock import held
with held(Path(sys.argv[1]), lambda: None):
    print("held", flush=True)
    time.sleep(float(sys.argv[2]))
    Path(sys.argv[1]).with_name("done").touch()
"""


def other_holds(path: Path, seconds: float) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path), str(seconds)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    return process


def test_a_second_process_waits_and_says_so(tmp_path: Path) -> None:
    path, waits = tmp_path / "folder" / "a.lock", []
    with (
        other_holds(path, 1.0) as process,
        held(path, lambda: waits.append(time.monotonic())) as waited,
    ):
        assert waited and len(waits) == 1 and path.with_name("done").exists()
    assert process.returncode == 0 and not path.exists()


def test_a_free_lock_is_taken_at_once_and_leaves_no_file(tmp_path: Path) -> None:
    with held(tmp_path / "a.lock", lambda: None) as waited:
        assert not waited and (tmp_path / "a.lock").exists()
    assert not list(tmp_path.iterdir())


def test_a_killed_process_holds_no_lock(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    with other_holds(path, 60) as process:
        process.kill()
    assert path.exists()
    with held(path, lambda: None) as waited:
        assert not waited


def test_ctrl_c_in_waiting_leaves_the_lock_to_its_holder(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    with other_holds(path, 60) as process:
        with (
            pytest.raises(KeyboardInterrupt),
            held(path, lambda: signal.raise_signal(signal.SIGINT)),
        ):
            pass
        with path.open("rb") as file, pytest.raises(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        process.kill()
