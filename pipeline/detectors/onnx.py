"""A detector that runs an ONNX file with ONNX Runtime: ours, or one of the common YOLO exports."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray
from onnxruntime.capi import onnxruntime_pybind11_state as ort
from pydantic import Field

from pipeline.artefacts.files import read_bytes
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.detectors import layouts
from pipeline.detectors.layouts import LAYOUTS, Layout, Letterbox
from pipeline.detectors.suppression import IOU, THRESHOLD, Share, inside, reported
from pipeline.errors import InputError, SimulationError

OURS = (
    "input 'image' (n, h, w, 3) uint8 RGB; outputs 'boxes' (n, cells, 4) in pixels and 'scores'"
    " (n, cells) in [0, 1]"
)
EXPECTED = (
    f"{OURS}; or a YOLO export: input (n, 3, h, w) float, one output in YOLOv5's, YOLOv8's or an"
    " end-to-end layout"
)
SMALLEST_BOXES = 2.0
"""Boxes with a largest coordinate up to this value are not in pixels."""
ERRORS = (
    ort.Fail,
    ort.InvalidArgument,
    ort.InvalidGraph,
    ort.InvalidProtobuf,
    ort.NotImplemented,
    ort.NoModel,
    ort.EPFail,
    ort.RuntimeException,
    ort.EngineError,
)
"""The exceptions of ONNX Runtime; they share no base class."""
Floats = NDArray[np.float32]


class OnnxDetector:
    """Finds pedestrians with an ONNX file.

    Our own files include normalisation and decoding, as `yolo.export` writes them. Other models get
    the image scaled to their size, padded with grey, as RGB in [0, 1]; the shape of their output
    determines its layout.

    Args:
        model: the file.
        threshold: smallest score reported, in (0, 1).
        iou: overlap above which the worse of two boxes is removed, in (0, 1).
        threads: of ONNX Runtime, in [1, 1024].
        layout: boxes_scores, yolov5, yolov8 or end_to_end, if the shape is ambiguous.
        person: name or number of the pedestrian class, if the file's class names do not say.

    Raises:
        InputError: if the file is missing or is not such a detector.
    """

    def __init__(
        self,
        model: str | Path,
        threshold: Share = THRESHOLD,
        iou: Share = IOU,
        threads: Annotated[int, Field(ge=1, le=1024)] = 1,
        layout: Layout | None = None,
        person: str | int | None = None,
    ) -> None:
        self._model, self._threshold, self._iou = Path(model), threshold, iou
        self._session = _session(self._model, threads)
        first = self._session.get_inputs()[0]
        self._input, self._shape = first.name, tuple(first.shape)
        self._float = np.float16 if first.type == "tensor(float16)" else np.float32
        self._layout: Layout = self._recognised(layout)
        self._person = 0
        if self._layout != "boxes_scores":
            names = layouts.class_names(self._session.get_modelmeta().custom_metadata_map)
            classes = layouts.classes_of(self._layout, self._session.get_outputs()[0].shape)
            classes = classes or len(names) or None
            self._person = layouts.person_class(self._model, names, classes, person)

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in the image.

        Raises:
            InputError: if a model of ours needs another image size.
            SimulationError: if the model fails on the image.
        """
        return self.detect_images(frame.image[None])[0]

    def detect_images(self, images: NDArray[np.uint8]) -> list[Detections]:
        """Detect in a batch; the same result as in single images, up to rounding.

        Args:
            images: (n, h, w, 3) uint8 RGB.

        Raises: as `detect`.
        """
        if self._layout != "boxes_scores":
            raw = [self._foreign(image) for image in images]
        else:
            wrong = images.dtype != np.uint8
            for extent, size in zip(self._shape[1:], images.shape[1:], strict=True):
                wrong = wrong or (isinstance(extent, int) and extent != size)
            if wrong:
                raise InputError(
                    f"{self._model} takes uint8 images of {self._shape[1:]},"
                    f" got {images.dtype} {images.shape[1:]}"
                )
            boxes, scores = self._run(["boxes", "scores"], np.ascontiguousarray(images))
            raw = list(zip(boxes, scores, strict=True))
        return [reported(self._model, *image, self._threshold, self._iou) for image in raw]

    def _foreign(self, image: NDArray[np.uint8]) -> tuple[Floats, Floats]:
        """Raw boxes (n, 4) in pixels and scores (n,) of a foreign model."""
        rows, columns = self._shape[2:]
        # A model that leaves its size open gets the image's, rounded up to the largest stride.
        stride = layouts.STRIDES[-1]
        height = rows if isinstance(rows, int) else -(-image.shape[0] // stride) * stride
        width = columns if isinstance(columns, int) else -(-image.shape[1] // stride) * stride
        padded, box = Letterbox.fit(image, width, height)
        channels_first = np.ascontiguousarray(padded.transpose(2, 0, 1)[None], np.float32)
        output = self._run(None, (channels_first / 255).astype(self._float))[0][0]
        boxes, scores = layouts.decode(self._layout, output, self._person)
        if 0 < (largest := layouts.largest(self._layout, output)) <= SMALLEST_BOXES:
            raise InputError(
                f"{self._model}: expected boxes in pixels of its {width} by {height} input,"
                f" got none beyond {largest:.3g}"
            )
        return inside(box.back(boxes), scores, image.shape[1], image.shape[0])

    def _run(self, outputs: list[str] | None, images: NDArray[Any]) -> Any:
        try:
            return self._session.run(outputs, {self._input: images})
        except ERRORS as error:
            raise SimulationError(
                f"{self._model} failed on an image: {str(error).splitlines()[0]}"
            ) from error

    def _recognised(self, declared: Layout | None) -> Layout:
        """The layout of the model's output; InputError if its inputs or outputs do not fit."""
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        first = inputs[0]
        if len(first.shape) == 4 and isinstance(first.shape[0], int) and first.shape[0] != 1:
            raise InputError(
                f"{self._model} takes batches of {first.shape[0]} images; export it for one image,"
                " or for any number"
            )
        shapes = {output.name: output.shape for output in outputs}
        actual = f"input '{first.name}' {first.shape} {first.type} and outputs {shapes}"
        ours = (
            [each.name for each in inputs] == ["image"]
            and first.type == "tensor(uint8)"
            and len(first.shape) == 4
            and len(shapes.get("boxes", ())) == 3
            and len(shapes.get("scores", ())) == 2
        )
        if ours:
            return "boxes_scores"
        if declared == "boxes_scores":
            raise InputError(f"{self._model} must have {OURS}; it has {actual}")
        if (
            len(inputs) != 1
            or first.type not in ("tensor(float)", "tensor(float16)")
            or len(first.shape) != 4
            or first.shape[1] not in (3, "channels")
            or len(outputs[0].shape) != 3
        ):
            raise InputError(f"{self._model} must have {EXPECTED}; it has {actual}")
        shape, (height, width) = outputs[0].shape, first.shape[2:]
        if not (isinstance(height, int) and isinstance(width, int)):
            height = width = 0
        layout = declared or layouts.recognise(shape, width, height)
        if layout is None:
            raise InputError(
                f"{self._model}: cannot recognise the layout of its output {shape};"
                f" set detector.layout to one of {', '.join(LAYOUTS[1:])}"
            )
        if not layouts.admits(layout, shape, width, height):
            raise InputError(
                f"{self._model}: detector.layout is {layout}, but an output {shape} cannot have"
                " this layout"
            )
        return layout


def _session(path: Path, threads: int) -> onnxruntime.InferenceSession:
    """Load a model; InputError if the file is missing, of another kind or damaged."""
    if path.suffix in (".pt", ".pth", ".pkl", ".ckpt"):
        raise InputError(
            f"{path}: a {path.suffix} file can run code when read, so it is not opened;"
            " export it to ONNX"
        )
    if path.is_dir():
        advice = ""
        for file in (path / "weights.safetensors", path / "model.onnx"):
            if file.exists():
                advice = f"; name the file, such as {file}"
        raise InputError(f"{path}: expected the file of a detector, got a folder{advice}")
    if not path.is_file():
        raise InputError(
            f"{path}: expected the ONNX file of a detector, found no file;"
            " train it or name another model"
        )
    data = read_bytes(path)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    # The runtime's errors become exceptions; it must not print them, too.
    options.log_severity_level = 4
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        session = onnxruntime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"]
        )
    except ERRORS as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"ONNX Runtime cannot load {path}: {reason}") from error
    layouts.check_alone(path, data)
    return session
