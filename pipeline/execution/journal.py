"""The journal of a campaign: each finished test execution as a file of its own, so that a kill loses only the tests under way."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.artefacts.dataset import encode_jpeg
from pipeline.artefacts.files import read_json, write_bytes, write_json
from pipeline.core import kpi
from pipeline.core.episode import Episode, KeptFrame

Signals = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Outcome:
    """What one test execution left: signals and kept frames, or the reason why the simulation broke."""

    signals: dict[str, NDArray[Any]]
    frames: list[dict[str, Any]]
    images: list[bytes]
    simulate_s: float
    reason: str = ""

    @property
    def broken(self) -> bool:
        return not self.signals


def outcome(episode: Episode, simulate_s: float) -> Outcome:
    """The outcome of a finished episode; frames are kept as JPEG."""
    images = [encode_jpeg(kept.frame.image) for kept in episode.frames]
    return Outcome(dict(episode.signals), [_frame(kept) for kept in episode.frames], images, simulate_s)


def _frame(kept: KeptFrame) -> dict[str, Any]:
    truth = kept.frame.truth
    matching = kpi.match(
        kept.detections.boxes, kept.detections.scores, truth.visible_box, truth.whole_box, truth.visible_pixels, truth.contrast
    )
    return {"step": kept.step, "truth": asdict(truth), "false_positives": matching.false_positives, "confidence": matching.confidence}


class Journal:
    """Outcomes by test index in a folder, bound to the identity of the campaign that they belong to."""

    def __init__(self, folder: Path, identity: str) -> None:
        """Open the folder; `discarded` tells whether outcomes of another campaign lay in it and were removed."""
        self._folder = folder
        mark = folder / "identity.json"
        self.discarded = folder.exists() and (not mark.exists() or read_json(mark) != identity)
        if self.discarded:
            shutil.rmtree(folder)
        write_json(mark, identity)

    def path(self, index: int) -> Path:
        return self._folder / f"{index:06d}.npz"

    def __contains__(self, index: int) -> bool:
        return self.path(index).exists()

    def __len__(self) -> int:
        return sum(1 for _ in self._folder.glob("*.npz"))

    def read(self, index: int) -> Outcome:
        """The outcome of a finished test."""
        with np.load(self.path(index), allow_pickle=False) as stored:
            about = json.loads(str(stored["about"]))
            signals = {name.removeprefix("signal_"): stored[name] for name in stored.files if name.startswith("signal_")}
            images = [stored[f"image_{i}"].tobytes() for i in range(len(about["frames"]))]
        return Outcome(signals, about["frames"], images, about["simulate_s"], about["reason"])

    def remove(self) -> None:
        """Delete the journal: the campaign's files are written."""
        shutil.rmtree(self._folder)


def write(path: Path, result: Outcome) -> None:
    """Write an outcome atomically."""
    about = json.dumps({"frames": result.frames, "simulate_s": result.simulate_s, "reason": result.reason})
    arrays: dict[str, NDArray[Any]] = {f"signal_{name}": column for name, column in result.signals.items()}
    arrays |= {f"image_{i}": np.frombuffer(image, np.uint8) for i, image in enumerate(result.images)}
    buffer = io.BytesIO()
    np.savez(buffer, about=np.array(about), **arrays)  # type: ignore[arg-type]
    write_bytes(path, buffer.getvalue())
