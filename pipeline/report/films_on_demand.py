"""Films of a study's tests, made on request and kept in data/<study>/films."""

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
"""A waiting request checks this often whether its client is still connected."""
START_S = 120
"""Longest time of the process without the test itself."""


@dataclass(frozen=True)
class MadeFilm:
    """An H.264 film.

    Attributes:
        video: Content of the file.
        changed: How the test ends now, if that differs from its row; such a film is not kept.
    """

    video: bytes
    changed: str = ""


class FilmsOnDemand:
    """Makes one film at a time, each in a separate process."""

    def __init__(self, folders: Folders, params: Path) -> None:
        """folders: of the study. params: its configuration."""
        self._folders, self._params = folders, params
        self._turn = Lock()

    def film(self, test: str, wanted: Callable[[], bool]) -> MadeFilm | None:
        """The film of a test.

        Args:
            test: Id of the test.
            wanted: Whether the client is still connected.

        Returns:
            The film; None if the client left before its turn came.

        Raises:
            InputError: The study has no such test, or it ended in an error, or it cannot be
                executed here.
        """
        kept = self._kept(test)
        while not kept.is_file():
            if self._turn.acquire(timeout=ASKED_AGAIN_S):
                try:
                    return self._make(test, kept)
                finally:
                    self._turn.release()
            if not wanted():
                return None
        return MadeFilm(kept.read_bytes())

    def _kept(self, test: str) -> Path:
        """Path of a film; its name contains the digest of everything it depends on."""
        version = str(recorded(self._folders, test)["version"])
        table = campaigns(self._folders)[test.rpartition("-")[0]]
        calibrations = map(Path, self._folders.calibrations([version]))
        files = [table, self._params, Path(self._folders.detector(version)), *calibrations]
        digests = "".join([program_sha256(), *map(sha256, files)])
        digest = hashlib.sha256(digests.encode()).hexdigest()
        return Path(self._folders.root, "films", f"{test}.{digest[:16]}.mp4")

    def _make(self, test: str, kept: Path) -> MadeFilm:
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
        """Make a film; returns how the test ends if that differs from the record."""
        command = [sys.executable, "-m", "pipeline", "replay", test]
        command += ["--params", str(self._params), "--out", str(new)]
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
            lines = done.stderr.splitlines() or [f"{test}: the film was not made"]
            raise InputError(one_line(lines[-1]))
        return one_line(done.stdout.removeprefix(f"{new}: ")) if done.returncode else ""
