"""The decisive moment of a test as its campaign recorded it: a kept frame and the detections in it."""

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
    """One kept frame. image: JPEG. size: its width and height in pixels. truth: box around the visible part of the pedestrian, in pixels;
    None if nothing of it is visible. detections: every stored box with its score, best first."""

    image: bytes
    size: tuple[int, int]
    truth: Box | None
    detections: tuple[tuple[Box, float], ...]


class KeptFrames:
    """The kept frames of campaigns. tables: frames.parquet of each, with detections.parquet beside it."""

    def __init__(self, tables: Sequence[Path]) -> None:
        self._tables: Mapping[Path, pd.DataFrame] = {
            path: read_frames(path, COLUMNS) for path in tables
        }

    @property
    def tests(self) -> frozenset[str]:
        """The tests with a kept frame."""
        return frozenset(
            str(test) for rows in self._tables.values() for test in rows["test_id"].unique()
        )

    def images(self, wanted: Collection[str]) -> dict[str, bytes]:
        """The decisive moment of each wanted test that has a kept frame, as JPEG."""
        return {
            test: image
            for _, rows, images in self._chosen(wanted)
            for test, image in zip(rows["test_id"], images, strict=True)
        }

    def moments(self, wanted: Collection[str]) -> dict[str, Moment]:
        """The same with the boxes in it."""
        return dict(moment for found in self._chosen(wanted) for moment in _with_boxes(*found))

    def _chosen(self, wanted: Collection[str]) -> Iterator[tuple[Path, pd.DataFrame, list[bytes]]]:
        """For each table with wanted tests: its path, the row of each test's moment, and the images."""
        for path, every in self._tables.items():
            chosen = [
                own.index[most_telling(own["visible_pixels"] > 0)]
                for _, own in every[every["test_id"].isin(wanted)].groupby("test_id", sort=False)
            ]
            if chosen:
                yield (
                    path,
                    every.loc[chosen],
                    read_frames(path, ["image"])["image"].loc[chosen].tolist(),
                )


def most_telling(visible: Iterable[bool]) -> int:
    """Which frame is a test's decisive moment: three quarters through those that show the pedestrian; the first if none does.

    visible: whether each frame shows the pedestrian.
    """
    shown = [index for index, one in enumerate(visible) if one]
    return shown[max(0, len(shown) * 3 // 4 - 1)] if shown else 0


def _with_boxes(
    path: Path, rows: pd.DataFrame, images: Sequence[bytes]
) -> Iterator[tuple[str, Moment]]:
    stored = read_detections(path.with_name("detections.parquet"))
    stored = (
        stored[stored["test_id"].isin(rows["test_id"])].set_index(["test_id", "step"]).sort_index()
    )
    for (_, row), image in zip(rows.iterrows(), images, strict=True):
        key, truth = (row["test_id"], row["step"]), frame_box(row, "visible")
        own = stored.loc[[key]] if key in stored.index else stored.iloc[:0]
        boxes = [
            ((left, top, right, bottom), score)
            for left, top, right, bottom, score in own[[*SIDES, "score"]].to_numpy(float).tolist()
        ]
        ranked = sorted(boxes, key=lambda found: -found[1])
        yield (
            str(row["test_id"]),
            Moment(image, Image.open(io.BytesIO(image)).size, truth, tuple(ranked)),
        )
