"""Detectors run with the Ultralytics package.

It is AGPL-3.0 and not installed with Blindspot: `pip install ultralytics`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.artefacts.files import read_bytes
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.detectors.layouts import check_alone, person_class
from pipeline.detectors.suppression import IOU, THRESHOLD, Share, inside, reported
from pipeline.errors import InputError, one_line


class UltralyticsDetector:
    """Finds pedestrians with an Ultralytics model, with Ultralytics' own pre- and postprocessing.

    Args:
        model: an .onnx file, or a .pt checkpoint if `trusted`.
        threshold, iou, person: as for `OnnxDetector`.
        trusted: whether the checkpoint may be read, which can run code in it.

    Raises:
        InputError: if the package or the file is missing, if the file is damaged or keeps its
            weights in another file, or if a checkpoint is not trusted.
    """

    def __init__(
        self,
        model: str | Path,
        threshold: Share = THRESHOLD,
        iou: Share = IOU,
        person: str | int | None = None,
        trusted: bool = False,
    ) -> None:
        path = Path(model)
        if path.suffix != ".onnx" and not trusted:
            raise InputError(
                f"{path}: a {path.suffix or 'foreign'} file can run code when read;"
                " export it to ONNX, or set detector.trusted=true"
            )
        if not path.is_file():
            raise InputError(f"{path}: expected a detector file, found none")
        if path.suffix == ".onnx":
            check_alone(path, read_bytes(path))
        try:
            from ultralytics import YOLO
        except ImportError as error:
            raise InputError(
                "this adapter needs Ultralytics' package (AGPL-3.0): pip install ultralytics"
                f" ({one_line(error)})"
            ) from error
        self._path, self._threshold, self._iou = path, threshold, iou
        # An ONNX file declares its image size, which older versions of the package read from the
        # file for the first image alone.
        self._sized = path.suffix != ".onnx"
        try:
            self._model = YOLO(str(path), task="detect")
            names = {int(number): str(name) for number, name in self._model.names.items()}
        except Exception as error:  # A damaged file makes the library raise anything.
            raise InputError(
                f"Ultralytics cannot load {path} as a detector: {one_line(error)}"
            ) from error
        self._person = person_class(path, names, len(names), person)

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in the image."""
        height, width = frame.image.shape[:2]
        (result,) = self._model.predict(
            np.ascontiguousarray(frame.image[..., ::-1]),  # Ultralytics takes BGR.
            conf=self._threshold,
            iou=self._iou,
            classes=[self._person],
            verbose=False,
            **({"imgsz": (height, width)} if self._sized else {}),
        )
        boxes, scores = result.boxes.xyxy.cpu().numpy(), result.boxes.conf.cpu().numpy()
        boxes, scores = inside(boxes, scores, width, height)
        return reported(self._path, boxes, scores, self._threshold, self._iou)
