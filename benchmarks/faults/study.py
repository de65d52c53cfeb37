"""A clone of HEAD with a tiny study, in which `./run` is killed and files are damaged: its phases, and its outcome to compare."""

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
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

from pipeline.artefacts import stamps

ROOT = Path(__file__).resolve().parents[2]
TINY = (
    *(
        "study=smoke",
        "search=[F1]",
        "held_out=[F1star]",
        "strategies=[random]",
        "~arms",
        "+arms={random: random}",
    ),
    *("campaign.tests=4", "comparison.tests=3", "base_set.images=12", "report.replays=1"),
    *("retraining.iterations=1", "retraining.batch_size=2", "retraining.added_frames=4"),
    *("filter.min_visible_pixels=0", "filter.min_detectability=0"),
    *("simulator.camera.width=160", "simulator.camera.height=96", "simulator.camera.rate_hz=4"),
)
"""The smallest study with a job of every rule of the default study."""
MADE = (
    "data/mlflow",
    "logs",
    ".snakemake",
    ".cache/recorded",
    "dvc.lock",
    ".dvc/cache",
    ".dvc/tmp",
)
CLOCKS = ("timings.parquet", "tracking.json")
"""Files that hold times or numbers of MLflow; all others are the same after every run."""
REGISTERED = (
    "runs",
    "registered_models",
    "model_versions",
    "logged_models WHERE lifecycle_stage = 'active'",
    "metrics",
    "tags",
)
"""MLflow's tables that are counted. MLflow keeps a logged model that was deleted: the incomplete one of a killed registration."""
STARTS = (
    (re.compile(r"\++ python -m pipeline (verify|verdict)"), None),
    (re.compile(r"\++ snakemake "), "planning"),
    (re.compile(r"(?:local)?rule (\w+):"), None),
    (re.compile(r"\++ record"), "record"),
    (re.compile(r"\++ (dvc commit) "), None),
)
"""Lines with which `bash -x run` and Snakemake begin a phase, and its name: the one given, or the line's own."""


@dataclass(frozen=True)
class Outcome:
    """What a finished study consists of. files: digests by path. registered: rows of MLflow's tables. dvc: what `dvc status` reports."""

    files: dict[str, str]
    registered: dict[str, int]
    dvc: str

    def differences(self, other: Outcome) -> list[str]:
        """The parts in which another outcome differs."""
        files = [
            path
            for path in sorted({*self.files, *other.files})
            if self.files.get(path) != other.files.get(path)
        ]
        return [
            *files,
            *(name for name in ("registered", "dvc") if asdict(self)[name] != asdict(other)[name]),
        ]


@dataclass(frozen=True)
class Run:
    """A finished or killed `./run`. phases: name and begin of each, in seconds. code: its exit code. said: its output."""

    phases: list[tuple[str, float]]
    code: int
    said: list[str]
    seconds: float

    @property
    def killed_in(self) -> str:
        return self.phases[-1][0]

    def durations(self) -> dict[str, float]:
        """The seconds of each phase, in the order of their first begin."""
        found: dict[str, float] = {}
        for (name, begin), (_, end) in zip(
            self.phases, [*self.phases[1:], ("", self.seconds)], strict=True
        ):
            found[name] = found.get(name, 0.0) + end - begin
        return found


class FaultStudy:
    """A clone in a folder, which is made anew unless it is of HEAD. overrides: the study, its name first. data: the study's folder."""

    def __init__(self, folder: Path, overrides: Sequence[str] = TINY) -> None:
        self.folder = folder.resolve()
        self.data = folder / "data" / overrides[0].removeprefix("study=")
        self._environment = {**os.environ, "PYTHONPATH": str(self.folder), "CORES": "2"}
        head = _said(["git", "rev-parse", "HEAD"], ROOT)
        if (
            not (folder / ".venv/ready").exists()
            or _said(["git", "rev-parse", "HEAD"], folder) != head
        ):
            shutil.rmtree(folder, ignore_errors=True)
            subprocess.run(["git", "clone", "--quiet", ROOT, folder], check=True)
            self._link_environment()
            (folder / ".venv/ready").touch()
        self.python("-m", "pipeline", "compose", *overrides)

    def _link_environment(self) -> None:
        """Use the packages that are installed here: the clone's pins are the same."""
        (self.folder / ".venv").mkdir()
        for file in Path(sys.prefix).iterdir():
            (self.folder / ".venv" / file.name).symlink_to(file)
        stamp = self.folder / ".venv/blindspot.stamp"
        stamp.unlink(missing_ok=True)
        pins = _said(
            ["bash", "-c", "cat pyproject.toml requirements.lock | sha256sum"], self.folder
        )
        stamp.write_text(f"{pins} {self.folder}\n")

    def python(self, *words: str) -> str:
        """The output of our Python in the clone."""
        return _said([sys.executable, *words], self.folder, self._environment)

    def clear(self) -> None:
        """Remove all that runs made."""
        for path in (self.data, *(self.folder / name for name in MADE)):
            stamps.remove(path)

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """`./run` with arguments, as the first of its own group of processes; its output tells each command before it runs."""
        command = ["bash", "-x", "run", *arguments]
        pipes = {
            "stdout": subprocess.PIPE,
            "stderr": subprocess.STDOUT,
            "stdin": subprocess.DEVNULL,
        }
        return subprocess.Popen(  # type: ignore[call-overload, no-any-return]
            command,
            cwd=self.folder,
            env=self._environment,
            text=True,
            start_new_session=True,
            **pipes,
        )

    def run(self, kill_when: Callable[[str], float | None] = lambda phase: None) -> Run:
        """`./run`. kill_when: told each phase as it begins, the seconds after which all processes are killed with -9, None for not now."""
        begin = time.monotonic()
        process = self.start()
        assert process.stdout is not None
        phases, said = [("set-up", 0.0)], []
        after_s = kill_when("set-up")
        timer = _kill_after(process, after_s)
        for line in process.stdout:
            said.append(line.rstrip("\n"))
            if (phase := phase_of(line)) is None:
                continue
            phases.append((phase, time.monotonic() - begin))
            if timer is None:
                timer = _kill_after(process, kill_when(phase))
        code = process.wait()
        if timer is not None:
            timer.cancel()
        return Run(phases, code, said, time.monotonic() - begin)

    def outcome(self) -> Outcome:
        """What the study consists of now."""
        files = {
            str(path.relative_to(self.data)): _digest(path)
            for path in sorted(self.data.rglob("*"))
            if path.is_file()
        }
        return Outcome(
            {path: digest for path, digest in files.items() if not path.endswith(CLOCKS)},
            dict(self._registered()),
            _said(
                [str(Path(sys.executable).with_name("dvc")), "status", "--json"],
                self.folder,
                self._environment,
            ),
        )

    def _registered(self) -> Iterator[tuple[str, int]]:
        store = self.folder / "data/mlflow/mlflow.db"
        if not store.exists():
            return
        with closing(sqlite3.connect(store)) as database:
            for table in REGISTERED:
                yield table, database.execute(f"SELECT COUNT(*) FROM {table}").fetchone()[0]
            yield (
                "unfinished",
                database.execute("SELECT COUNT(*) FROM runs WHERE status != 'FINISHED'").fetchone()[
                    0
                ],
            )


def phase_of(line: str) -> str | None:
    """The phase that begins with a line of a run's output."""
    for pattern, name in STARTS:
        if found := pattern.match(line):
            return name or found[1]
    return None


def _digest(path: Path) -> str:
    """A file's digest; a stamp's without the lines of files that hold clocks."""
    if path.suffix != stamps.SUFFIX or (stamp := stamps.read(path)) is None:
        return stamps.digest(path)
    return json.dumps(
        [
            stamp.depends,
            {
                name: value
                for name, value in sorted(stamp.digests.items())
                if not name.endswith(CLOCKS)
            },
        ]
    )


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


def _said(command: Sequence[str], folder: Path, environment: dict[str, str] | None = None) -> str:
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()
