"""The decisive moment of a test as its campaign recorded it: a kept frame and its detections."""

from __future__ import annotations

import io
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from PIL import Image

from pipeline.artefacts.tables import frame_box, read_detections, read_frames
from pipeline.core.boxes import Box
from pipeline.core.signals import SIDES

COLUMNS = ("test_id", "step", "visible_pixels", *(f"visible_{side}" for side in SIDES))


@dataclass(frozen=True)
class Moment:
    """One kept frame.

    Attributes:
        image: JPEG.
        size: Width and height of the image in pixels.
        truth: Box around the visible part of the pedestrian, in pixels; None if it is hidden.
        detections: Every stored box with its score, best first.
    """

    image: bytes
    size: tuple[int, int]
    truth: Box | None
    detections: tuple[tuple[Box, float], ...]


class KeptFrames:
    """The kept frames of campaigns."""

    def __init__(self, tables: Sequence[Path]) -> None:
        """tables: frames.parquet of each campaign, with detections.parquet beside it."""
        self._tables: Mapping[Path, pd.DataFrame] = {
            path: read_frames(path, COLUMNS) for path in tables
        }

    @property
    def tests(self) -> frozenset[str]:
        """The tests with a kept frame."""
        tests: set[str] = set()
        for rows in self._tables.values():
            tests.update(map(str, rows["test_id"].unique()))
        return frozenset(tests)

    def images(self, wanted: Collection[str]) -> dict[str, bytes]:
        """The decisive moment of each wanted test that has a kept frame, as JPEG."""
        result: dict[str, bytes] = {}
        for _, rows, images in self._chosen(wanted):
            result |= zip(rows["test_id"], images, strict=True)
        return result

    def moments(self, wanted: Collection[str]) -> dict[str, Moment]:
        """The decisive moment of each wanted test that has a kept frame, with its boxes."""
        result = {}
        for path, rows, images in self._chosen(wanted):
            stored = read_detections(path.with_name("detections.parquet"))
            stored = stored[stored["test_id"].isin(rows["test_id"])]
            stored = stored.set_index(["test_id", "step"]).sort_index()
            for (_, row), image in zip(rows.iterrows(), images, strict=True):
                key = (row["test_id"], row["step"])
                of_frame = stored.loc[[key]] if key in stored.index else stored.iloc[:0]
                detections: list[tuple[Box, float]] = []
                for *box, score in of_frame[[*SIDES, "score"]].to_numpy(float).tolist():
                    left, top, right, bottom = box
                    detections.append(((left, top, right, bottom), score))
                detections.sort(key=lambda detection: -detection[1])
                size, truth = Image.open(io.BytesIO(image)).size, frame_box(row, "visible")
                result[str(row["test_id"])] = Moment(image, size, truth, tuple(detections))
        return result

    def _chosen(self, wanted: Collection[str]) -> Iterator[tuple[Path, pd.DataFrame, list[bytes]]]:
        """Path, rows of the tests' moments and images, for each table with wanted tests."""
        for path, every in self._tables.items():
            tests = every[every["test_id"].isin(wanted)].groupby("test_id", sort=False)
            chosen = [rows.index[most_telling(rows["visible_pixels"] > 0)] for _, rows in tests]
            if chosen:
                images = read_frames(path, ["image"])["image"].loc[chosen].tolist()
                yield path, every.loc[chosen], images


def most_telling(visible: Iterable[bool]) -> int:
    """Index of a test's decisive frame.

    It lies three quarters through the frames that show the pedestrian; if none does, it is the
    first.

    Args:
        visible: Whether each frame shows the pedestrian.
    """
    shown = [index for index, in_sight in enumerate(visible) if in_sight]
    return shown[max(0, len(shown) * 3 // 4 - 1)] if shown else 0
