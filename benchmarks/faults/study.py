"""A clone of HEAD with a tiny study, in which `./run` is killed and files are damaged."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from pipeline.artefacts import stamps

ROOT = Path(__file__).resolve().parents[2]
TINY = (
    *("study=smoke", "search=[F1]", "held_out=[F1star]", "strategies=[random]"),
    *("~arms", "+arms={random: random}"),
    *("campaign.tests=4", "comparison.tests=3", "base_set.images=12", "report.replays=1"),
    *("retraining.iterations=1", "retraining.batch_size=2", "retraining.added_frames=4"),
    *("filter.min_visible_pixels=0", "filter.min_detectability=0"),
    *("simulator.camera.width=160", "simulator.camera.height=96", "simulator.camera.rate_hz=4"),
)
"""The smallest study with a job of every rule of the default study."""
OUTPUTS = (
    *("data/mlflow", "logs", ".snakemake", ".cache/recorded"),
    *("dvc.lock", ".dvc/cache", ".dvc/tmp"),
)
"""What runs write beside the study's folder."""
CLOCKS = ("timings.parquet", "tracking.json")
"""Files that hold times or numbers of MLflow; all others are the same after every run."""
COUNTED = {
    "runs": "runs",
    "registered_models": "registered_models",
    "model_versions": "model_versions",
    # MLflow keeps a deleted logged model: the incomplete one of a killed registration.
    "logged_models": "logged_models WHERE lifecycle_stage = 'active'",
    "metrics": "metrics",
    "tags": "tags",
    "unfinished": "runs WHERE status != 'FINISHED'",
}
"""Rows of MLflow's tables."""
STARTS = (
    (re.compile(r"\++ python -m pipeline (verify|verdict)"), None),
    (re.compile(r"\++ snakemake "), "planning"),
    (re.compile(r"(?:local)?rule (\w+):"), None),
    (re.compile(r"\++ record"), "record"),
    (re.compile(r"\++ (dvc commit) "), None),
)
"""Lines with which `bash -x run` and Snakemake begin a phase; its name, or None for the group's."""


@dataclass(frozen=True)
class Outcome:
    """A finished study.

    files: digests by path. registered: rows of MLflow's tables. dvc: what `dvc status` reports.
    """

    files: dict[str, str]
    registered: dict[str, int]
    dvc: str

    def differences(self, other: Outcome) -> list[str]:
        """The parts in which another outcome differs."""
        paths = sorted({*self.files, *other.files})
        parts = [path for path in paths if self.files.get(path) != other.files.get(path)]
        parts += ["registered"] if self.registered != other.registered else []
        return parts + (["dvc"] if self.dvc != other.dvc else [])


@dataclass(frozen=True)
class Run:
    """A finished or killed `./run`.

    phases: name and begin of each, in seconds. code: exit code. output: its lines.
    """

    phases: list[tuple[str, float]]
    code: int
    output: list[str]
    seconds: float

    @property
    def killed_in(self) -> str:
        """The last phase."""
        return self.phases[-1][0]

    def durations(self) -> dict[str, float]:
        """The seconds of each phase, in the order of their first begin."""
        seconds: dict[str, float] = {}
        ends = [*self.phases[1:], ("", self.seconds)]
        for (name, begin), (_, end) in zip(self.phases, ends, strict=True):
            seconds[name] = seconds.get(name, 0.0) + end - begin
        return seconds


class FaultStudy:
    """A study in a clone, which is cloned anew unless it is of HEAD.

    Args:
        folder: The clone.
        overrides: The arguments of `compose`, the study's name first.
    """

    def __init__(self, folder: Path, overrides: Sequence[str] = TINY) -> None:
        self.folder = folder.resolve()
        self.data = folder / "data" / overrides[0].removeprefix("study=")
        self._environment = {**os.environ, "PYTHONPATH": str(self.folder), "CORES": "2"}
        ready, command = folder / ".venv/ready", ["git", "rev-parse", "HEAD"]
        if not ready.exists() or output_of(command, folder) != output_of(command, ROOT):
            shutil.rmtree(folder, ignore_errors=True)
            subprocess.run(["git", "clone", "--quiet", ROOT, folder], check=True)
            self._link_environment()
            ready.touch()
        self.python("-m", "pipeline", "compose", *overrides)

    def _link_environment(self) -> None:
        """Use the packages that are installed here: the clone's pins are the same."""
        (self.folder / ".venv").mkdir()
        for file in Path(sys.prefix).iterdir():
            (self.folder / ".venv" / file.name).symlink_to(file)
        stamp = self.folder / ".venv/blindspot.stamp"
        stamp.unlink(missing_ok=True)
        command = ["bash", "-c", "cat pyproject.toml requirements.lock | sha256sum"]
        stamp.write_text(f"{output_of(command, self.folder)} {self.folder}\n")

    def python(self, *words: str) -> str:
        """The output of our Python in the clone."""
        return output_of([sys.executable, *words], self.folder, self._environment)

    def clear(self) -> None:
        """Remove everything that runs wrote."""
        for path in (self.data, *(self.folder / name for name in OUTPUTS)):
            stamps.remove(path)

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """`./run` as the first of its group of processes; its output names each command."""
        return subprocess.Popen(
            ["bash", "-x", "run", *arguments],
            cwd=self.folder,
            env=self._environment,
            text=True,
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )

    def run(self, kill_when: Callable[[str], float | None] = lambda phase: None) -> Run:
        """Execute `./run`.

        Args:
            kill_when: Called with each phase as it begins; returns the seconds after which all
                processes are killed with -9, or None.
        """
        begin = time.monotonic()
        process = self.start()
        assert process.stdout is not None
        phases, output = [("set-up", 0.0)], []
        timer = _kill_after(process, kill_when("set-up"))
        for line in process.stdout:
            output.append(line.rstrip("\n"))
            if (phase := phase_of(line)) is None:
                continue
            phases.append((phase, time.monotonic() - begin))
            if timer is None:
                timer = _kill_after(process, kill_when(phase))
        code = process.wait()
        if timer is not None:
            timer.cancel()
        return Run(phases, code, output, time.monotonic() - begin)

    def outcome(self) -> Outcome:
        """The study as it is now."""
        files = {}
        for path in sorted(self.data.rglob("*")):
            if path.is_file() and not path.name.endswith(CLOCKS):
                files[str(path.relative_to(self.data))] = file_digest(path)
        store, registered = self.folder / "data/mlflow/mlflow.db", {}
        if store.exists():
            with closing(sqlite3.connect(store)) as database:
                for name, rows in COUNTED.items():
                    count = database.execute(f"SELECT COUNT(*) FROM {rows}")
                    registered[name] = count.fetchone()[0]
        dvc = [str(Path(sys.executable).with_name("dvc")), "status", "--json"]
        return Outcome(files, registered, output_of(dvc, self.folder, self._environment))


def phase_of(line: str) -> str | None:
    """The phase that begins with a line of a run's output."""
    for pattern, name in STARTS:
        if match := pattern.match(line):
            return name or match[1]
    return None


def file_digest(path: Path) -> str:
    """A file's digest; a stamp's without the lines of files that hold clocks."""
    stamp = stamps.read(path) if path.suffix == stamps.SUFFIX else None
    if stamp is None:
        return stamps.digest(path)
    kept = {name: it for name, it in sorted(stamp.digests.items()) if not name.endswith(CLOCKS)}
    return json.dumps([stamp.depends, kept])


def _kill_after(process: subprocess.Popen[str], seconds: float | None) -> threading.Timer | None:
    if seconds is None:
        return None
    timer = threading.Timer(seconds, kill, [process])
    timer.start()
    return timer


def kill(process: subprocess.Popen[str]) -> None:
    """Kill a run with -9, with all its processes on this machine."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)


def output_of(
    command: Sequence[str], folder: Path, environment: dict[str, str] | None = None
) -> str:
    """The standard output of a command in a folder; it must succeed."""
    finished = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return finished.stdout.strip()


def say(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr, flush=True)
