"""The journal of a campaign: each finished test is its own sealed file.

So a kill or a damaged file loses only single tests.
"""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.artefacts.dataset import encode_jpeg
from pipeline.artefacts.files import read_sealed, write_sealed
from pipeline.artefacts.stamps import remove
from pipeline.artefacts.tables import detection_columns, frame_row
from pipeline.core.episode import Episode
from pipeline.core.kpi import NO_KPI, Kpi, evaluate
from pipeline.core.signals import Signals
from pipeline.core.space import Value
from pipeline.errors import InputError
from pipeline.progress import Progress

SIGNAL, DETECTION = "signal_", "detection_"
"""Prefixes of the arrays in an outcome's file."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of one test execution.

    signals: none for an error, which has a reason instead. detections, frames: columns and rows of
    their tables, without test_id.
    """

    signals: Signals
    detections: Mapping[str, NDArray[Any]]
    frames: tuple[Mapping[str, Any], ...]
    simulate_s: float
    reason: str = ""

    @staticmethod
    def of(episode: Episode, simulate_s: float) -> Outcome:
        """The outcome of a finished episode; frames are stored as JPEG."""
        frames = tuple(
            frame_row(kept) | {"image": encode_jpeg(kept.frame.image)} for kept in episode.frames
        )
        return Outcome(episode.signals, detection_columns(episode.detections), frames, simulate_s)

    @staticmethod
    def error(reason: str, simulate_s: float = 0.0) -> Outcome:
        """The outcome of an error.

        A reason with half a character, as in the name of a file that is not UTF-8, is escaped.
        """
        return Outcome(
            {},
            detection_columns(()),
            (),
            simulate_s,
            reason.encode("utf-8", "backslashreplace").decode(),
        )

    @property
    def is_error(self) -> bool:
        return not self.signals

    @property
    def status(self) -> str:
        """As in tests.parquet."""
        return "error" if self.is_error else "ok"

    def kpi(self, failure_threshold_s: float) -> Kpi:
        """Its KPIs; `NO_KPI` for an error."""
        return NO_KPI if self.is_error else evaluate(self.signals, failure_threshold_s)


class Journal:
    """Outcomes by test index in a folder, bound to the identity of one campaign."""

    def __init__(self, folder: Path, identity: str, progress: Progress) -> None:
        """Open the folder.

        Outcomes of another campaign are removed, and so are damaged ones, each with a note.

        Raises InputError with the command to type if it cannot be told whose outcomes they are.
        """
        self._folder, self._progress, mark = folder, progress, folder / "identity"
        if folder.exists() and (not mark.exists() or _identity(mark) != identity):
            shutil.rmtree(folder)
            progress.note(
                "the journal belonged to another configuration, model or code and was discarded"
            )
        write_sealed(mark, identity.encode())
        for path in sorted(folder.glob("*.npz")):
            try:
                read_sealed(path)
            except InputError:
                remove(path)
                progress.note(f"{path} was damaged; its test is executed again")

    def path(self, index: int) -> Path:
        return self._folder / f"{index:06d}.npz"

    def __contains__(self, index: int) -> bool:
        return self.path(index).exists()

    def holds(self, index: int, concrete: Mapping[str, Value]) -> bool:
        """Whether the outcome of this concrete scenario is here.

        One of another scenario is removed with a note: a strategy of the user's own may have
        changed, or a library that it uses.
        """
        if index not in self:
            return False
        with np.load(io.BytesIO(read_sealed(self.path(index))), allow_pickle=False) as stored:
            if _about(stored)["concrete"] == dict(concrete):
                return True
        remove(self.path(index))
        self._progress.note(f"the strategy now asks for another test {index}; it is executed again")
        return False

    def read(self, index: int) -> Outcome:
        """The outcome of a finished test."""
        with np.load(io.BytesIO(read_sealed(self.path(index))), allow_pickle=False) as stored:
            about = _about(stored)
            signals, detections = (_columns(stored, kind) for kind in (SIGNAL, DETECTION))
            frames = tuple(
                row | {"image": stored[f"image_{i}"].tobytes()}
                for i, row in enumerate(about["frames"])
            )
        return Outcome(signals, detections, frames, about["simulate_s"], about["reason"])

    def remove(self) -> None:
        """Delete the journal of a campaign that is not to be resumed."""
        shutil.rmtree(self._folder)


def identity_of(folder: Path) -> str | None:
    """The identity that a journal's folder is bound to; None without one."""
    return _identity(mark) if (mark := folder / "identity").exists() else None


def _identity(mark: Path) -> str:
    try:
        return read_sealed(mark).decode()
    except InputError as error:
        again = f"to execute the finished tests beside it again, type: rm -r {mark.parent}"
        raise InputError(
            f"{mark}: damaged, so the journal may belong to another campaign; {again}"
        ) from error


def _columns(stored: Mapping[str, NDArray[Any]], kind: str) -> dict[str, NDArray[Any]]:
    """The arrays whose names begin with a kind, by the rest of their names."""
    return {name.removeprefix(kind): stored[name] for name in stored if name.startswith(kind)}


def _about(stored: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    return dict(json.loads(str(stored["about"])))


def write(path: Path, outcome: Outcome, concrete: Mapping[str, Value]) -> None:
    """Write the outcome of a concrete scenario atomically."""
    rows = [dict(row) for row in outcome.frames]
    for row in rows:
        del row["image"]
    about = json.dumps(
        {
            "concrete": dict(concrete),
            "frames": rows,
            "simulate_s": outcome.simulate_s,
            "reason": outcome.reason,
        }
    )
    arrays: dict[str, NDArray[Any]] = {
        SIGNAL + name: column for name, column in outcome.signals.items()
    }
    arrays |= {DETECTION + name: column for name, column in outcome.detections.items()}
    arrays |= {
        f"image_{i}": np.frombuffer(row["image"], np.uint8) for i, row in enumerate(outcome.frames)
    }
    buffer = io.BytesIO()
    np.savez(buffer, about=np.array(about), **arrays)  # type: ignore[arg-type]
    write_sealed(path, buffer.getvalue())
