"""A detector that runs an ONNX file by ONNX Runtime."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnxruntime
from numpy.typing import NDArray
from onnxruntime.capi.onnxruntime_pybind11_state import Fail, InvalidArgument, InvalidGraph, InvalidProtobuf

from pipeline.core.boxes import nms
from pipeline.protocols import Detections, Frame, InputError

CANDIDATES = 300
"""Boxes before suppression; far more than a street has people."""
EXPECTED = "input 'image' (n, h, w, 3) uint8 RGB; outputs 'boxes' (n, cells, 4) in pixels and 'scores' (n, cells) in [0, 1]"


class OnnxDetector:
    """Finds pedestrians with an ONNX file that has normalisation and decoding inside, as `yolo.export` writes it.

    model: the file. threshold: smallest score reported, in (0, 1). iou: overlap above which the worse of two boxes falls, in
    (0, 1). threads: of ONNX Runtime. InputError if the file is missing or is no such detector.
    """

    def __init__(self, model: str | Path, threshold: float = 0.5, iou: float = 0.45, threads: int = 1) -> None:
        for name, value in {"threshold": threshold, "iou": iou}.items():
            if not 0 < value < 1:
                raise InputError(f"detector.{name} must be in (0, 1), got {value}")
        if threads < 1:
            raise InputError(f"detector.threads must be at least 1, got {threads}")
        self._session = _session(Path(model), threads)
        self._shape = tuple(self._session.get_inputs()[0].shape[1:])
        self._model, self._threshold, self._iou = Path(model), threshold, iou

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in the image; InputError if it has not the size that the model was made for."""
        return self.detect_images(frame.image[None])[0]

    def detect_images(self, images: NDArray[np.uint8]) -> list[Detections]:
        """(n, h, w, 3) uint8 RGB to n detections; the same as one by one up to rounding."""
        if images.dtype != np.uint8 or any(e != g for e, g in zip(self._shape, images.shape[1:], strict=True) if _fixed(e)):
            raise InputError(f"{self._model} takes uint8 images of {self._shape}, got {images.dtype} {images.shape[1:]}")
        boxes, scores = self._session.run(["boxes", "scores"], {"image": np.ascontiguousarray(images)})
        return [self._reported(b, s) for b, s in zip(boxes, scores, strict=True)]

    def _reported(self, boxes: NDArray[np.float32], scores: NDArray[np.float32]) -> Detections:
        above = np.flatnonzero(scores >= self._threshold)
        if not len(above):
            return Detections.none()
        if len(above) > CANDIDATES:
            above = above[np.argsort(-scores[above], kind="stable")[:CANDIDATES]]
        kept = above[nms(boxes[above], scores[above], self._iou)] if len(above) > 1 else above
        return Detections(boxes[kept], scores[kept])


def _fixed(extent: int | str | None) -> bool:
    return isinstance(extent, int)


def _session(path: Path, threads: int) -> onnxruntime.InferenceSession:
    if not path.is_file():
        raise InputError(f"{path}: expected the ONNX file of a detector, found no file; train it, or name another model")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except (Fail, InvalidArgument, InvalidGraph, InvalidProtobuf) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path} is no ONNX file that ONNX Runtime can load: {reason}") from error
    inputs, outputs = session.get_inputs(), {output.name: output.shape for output in session.get_outputs()}
    if [i.name for i in inputs] != ["image"] or inputs[0].type != "tensor(uint8)" or len(inputs[0].shape) != 4:
        found = ", ".join(f"'{i.name}' {i.shape} {i.type}" for i in inputs)
        raise InputError(f"{path} must have {EXPECTED}; it has input {found}")
    if len(outputs.get("boxes", ())) != 3 or len(outputs.get("scores", ())) != 2:
        raise InputError(f"{path} must have {EXPECTED}; it has outputs {outputs}")
    return session
