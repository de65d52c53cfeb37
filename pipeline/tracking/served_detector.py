"""The detector that MLflow loads: images of any size in, boxes of pedestrians out.

MLflow copies this file beside the model and runs it where Blindspot is not installed, so it imports
nothing from this package.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import cv2
import mlflow
import numpy as np
import onnxruntime
import pandas as pd
from mlflow.pyfunc import PythonModel
from numpy.typing import NDArray

GREY = 114  # As in `detectors.layouts`.
COLUMNS = ("image", "left", "top", "right", "bottom", "score")
Floats = NDArray[np.float32]


with warnings.catch_warnings():  # MLflow asks for hints that it would take for a schema.
    warnings.filterwarnings("ignore", message=".*Add type hints")

    class ServedDetector(PythonModel):  # type: ignore[misc]  # MLflow has no types.
        """Finds pedestrians with the ONNX file of a version.

        Its model_config has `threshold`, the smallest reported score, and `iou`, the overlap above
        which the worse of two boxes is removed; `load_model` accepts other values.
        """

        def load_context(self, context: Any) -> None:
            """Open the ONNX file; MLflow calls it once."""
            self._session = onnxruntime.InferenceSession(
                context.artifacts["onnx"], providers=["CPUExecutionProvider"]
            )
            _, self._height, self._width, _ = self._session.get_inputs()[0].shape

        # Without type hints, because MLflow would turn them into a schema.
        def predict(self, context, model_input, params=None):  # type: ignore[no-untyped-def]
            """The pedestrians in images.

            Args:
                context: MLflow's context, with `threshold` and `iou`.
                model_input: (n, h, w, 3) uint8 RGB.
                params: Not used.

            Returns:
                A row for each pedestrian: number of the image, box in its pixels, score.
            """
            limits, rows = context.model_config, []
            for number, image in enumerate(model_input):
                pixels = np.asarray(image, np.uint8)
                for box, score in self._detect(pixels, limits["threshold"], limits["iou"]):
                    rows.append((number, *map(float, box), float(score)))
            kinds = {"image": "int64"} | dict.fromkeys(COLUMNS[1:], "float64")
            return pd.DataFrame(rows, columns=list(COLUMNS)).astype(kinds)

        def _detect(
            self, image: NDArray[np.uint8], threshold: float, iou: float
        ) -> Iterator[tuple[Floats, np.float32]]:
            height, width = image.shape[:2]
            scale = min(self._width / width, self._height / height)
            columns, rows = round(width * scale), round(height * scale)
            left, top = (self._width - columns) // 2, (self._height - rows) // 2
            padded = np.full((self._height, self._width, 3), GREY, np.uint8)
            scaled = image if scale == 1 else cv2.resize(image, (columns, rows))
            padded[top : top + rows, left : left + columns] = scaled
            outputs = self._session.run(["boxes", "scores"], {"image": padded[None]})
            boxes, scores = (output[0] for output in outputs)
            boxes = (boxes - (left, top, left, top)) / scale
            boxes = np.clip(boxes, 0, (width, height, width, height)).astype(np.float32)
            # Of a box in the grey border, nothing is left.
            real = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
            boxes, scores = boxes[real], scores[real]
            for kept in suppressed(boxes, np.where(scores >= threshold, scores, -1), iou):
                yield boxes[kept], scores[kept]


def suppressed(boxes: Floats, scores: Floats, iou: float) -> Iterator[int]:
    """Indices of the boxes that no better one overlaps by more than `iou`, best first.

    Args:
        boxes: (n, 4) left, top, right, bottom.
        scores: (n,); boxes with a negative score do not count.
        iou: Largest overlap, in [0, 1].
    """
    order = np.argsort(-scores, kind="stable")
    order = order[scores[order] >= 0]
    areas = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    while len(order):
        best, order = order[0], order[1:]
        yield int(best)
        end = np.minimum(boxes[best, 2:], boxes[order, 2:])
        start = np.maximum(boxes[best, :2], boxes[order, :2])
        shared = np.clip(end - start, 0, None).prod(axis=1)
        order = order[shared <= iou * (areas[best] + areas[order] - shared)]


mlflow.models.set_model(ServedDetector())
