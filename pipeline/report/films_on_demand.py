"""Films of a study's tests, made when somebody asks for one and kept in data/<study>/films."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

from pipeline.artefacts.files import program_sha256, sha256
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.recorded_tests import campaigns, recorded
from pipeline.errors import InputError, one_line

ASKED_AGAIN_S = 0.5
"""A request that waits for its turn asks this often whether somebody still wants its film."""
START_S = 120
"""Longest time that the process takes for everything but the test."""


@dataclass(frozen=True)
class MadeFilm:
    """An H.264 film. changed: how the test now ends, if it ends otherwise than its row says; such a film is not kept."""

    video: bytes
    changed: str = ""


class FilmsOnDemand:
    """Makes one film at a time, each in a process of its own. params: the study's configuration."""

    def __init__(self, folders: Folders, params: Path) -> None:
        self._folders, self._params = folders, params
        self._turn = Lock()

    def film(self, test: str, wanted: Callable[[], bool]) -> MadeFilm | None:
        """The film of a test, or None if nobody wants it any more before its turn comes.

        InputError for a test that the study does not have, that ended in an error, or that cannot be executed here.
        """
        kept = self._kept(test)
        while not kept.is_file():
            if self._turn.acquire(timeout=ASKED_AGAIN_S):
                try:
                    return self._read_or_made(test, kept)
                finally:
                    self._turn.release()
            if not wanted():
                return None
        return MadeFilm(kept.read_bytes())

    def _kept(self, test: str) -> Path:
        """Where a film is kept: its name holds the digest of all that it depends on."""
        version = str(recorded(self._folders, test)["version"])
        table = campaigns(self._folders)[test.rpartition("-")[0]]
        files = [
            table,
            self._params,
            Path(self._folders.detector(version)),
            *map(Path, self._folders.calibrations([version])),
        ]
        digest = hashlib.sha256(
            "".join([program_sha256(), *map(sha256, files)]).encode()
        ).hexdigest()
        return Path(self._folders.root, "films", f"{test}.{digest[:16]}.mp4")

    def _read_or_made(self, test: str, kept: Path) -> MadeFilm:
        if kept.is_file():  # Another request made it in the meantime.
            return MadeFilm(kept.read_bytes())
        new = kept.with_name(f"new-{test}.mp4")
        new.unlink(missing_ok=True)
        changed = self._replay(test, new)
        if changed:
            video = new.read_bytes()
            new.unlink()
            return MadeFilm(video, changed)
        for old in kept.parent.glob(f"{test}.*.mp4"):
            old.unlink()
        new.replace(kept)
        return MadeFilm(kept.read_bytes())

    def _replay(self, test: str, new: Path) -> str:
        """Make a film; returns how the test ends if that is not as recorded."""
        command = [
            sys.executable,
            "-m",
            "pipeline",
            "replay",
            test,
            "--params",
            str(self._params),
            "--out",
            str(new),
        ]
        longest_s = START_S + self._folders.config.limits.test_s
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                stdin=subprocess.DEVNULL,
                timeout=longest_s,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise InputError(f"{test}: no film after {longest_s:g} s") from error
        if not new.is_file():
            raise InputError(
                one_line((done.stderr.splitlines() or [f"{test}: the film was not made"])[-1])
            )
        return one_line(done.stdout.removeprefix(f"{new}: ")) if done.returncode else ""
