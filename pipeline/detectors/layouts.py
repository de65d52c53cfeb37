"""Input and output layouts of foreign ONNX detectors: YOLOv5, YOLOv8/11 and end-to-end exports.

They are recognised by their shapes, or declared.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError

Floats = NDArray[np.float32]
Layout = Literal["boxes_scores", "yolov5", "yolov8", "end_to_end"]
LAYOUTS: tuple[Layout, ...] = ("boxes_scores", "yolov5", "yolov8", "end_to_end")
PEOPLE = ("pedestrian", "person", "people")
STRIDES = (8, 16, 32)
GREY = 114
"""The padding grey of YOLO's trainers."""
MOST_FINAL_BOXES = 1000
"""An end-to-end output has at most this many boxes; a grid of anchors has more."""


@dataclass(frozen=True)
class Letterbox:
    """An image scaled to fit and padded.

    Attributes:
        scale: of both sides.
        left, top: padding in pixels.
    """

    scale: float
    left: int
    top: int

    @staticmethod
    def fit(
        image: NDArray[np.uint8], width: int, height: int
    ) -> tuple[NDArray[np.uint8], Letterbox]:
        """Scale and pad an image (h, w, 3) to (height, width, 3).

        >>> padded, box = Letterbox.fit(np.zeros((2, 4, 3), np.uint8), width=8, height=8)
        >>> padded.shape, box
        ((8, 8, 3), Letterbox(scale=2.0, left=0, top=2))
        """
        old_height, old_width = image.shape[:2]
        scale = min(width / old_width, height / old_height)
        new = round(old_width * scale), round(old_height * scale)
        left, top = (width - new[0]) // 2, (height - new[1]) // 2
        if new != (old_width, old_height):
            image = np.asarray(cv2.resize(image, new, interpolation=cv2.INTER_LINEAR), np.uint8)
        padded = np.full((height, width, 3), GREY, np.uint8)
        padded[top : top + new[1], left : left + new[0]] = image
        return padded, Letterbox(scale, left, top)

    def back(self, boxes: Floats) -> Floats:
        """Convert boxes (n, 4) of the padded image to pixels of the original image."""
        padding = (self.left, self.top, self.left, self.top)
        return np.asarray((boxes - padding) / self.scale, np.float32)


def check_alone(path: Path, data: bytes) -> None:
    """Check that an ONNX model has its weights in its own file.

    The digest of a model would not change with weights in other files.

    Args:
        path: of the model, for the message.
        data: its bytes.

    Raises:
        InputError: names the other files and a command that puts the weights into the model.
    """
    if b"location" not in data:  # Of a file with weights. Importing onnx takes longer than tests.
        return
    import onnx

    beside = set()
    for tensor in _tensors(onnx.load_from_string(data).graph):
        beside |= {entry.value for entry in tensor.external_data if entry.key == "location"}
    if beside:
        command = f"python -c \"import onnx; onnx.save(onnx.load('{path}'), '{path}')\""
        raise InputError(
            f"{path}: expected one file, but its weights are in {', '.join(sorted(beside))};"
            f" put them into it: {command}"
        )


def _tensors(graph: Any) -> Iterator[Any]:
    """The constants of an ONNX graph and of the graphs in it."""
    yield from graph.initializer
    for node in graph.node:
        for attribute in node.attribute:
            yield from (attribute.t, *attribute.tensors)
            for inner in (attribute.g, *attribute.graphs):
                yield from _tensors(inner)


def recognise(shape: Sequence[int | str | None], width: int, height: int) -> Layout | None:
    """The layout of an output.

    YOLOv5 has three anchors per cell in rows, YOLOv8 one in columns, an end-to-end export a few
    rows of six. An open number of rows of six may also be YOLOv5 with one class.

    Args:
        shape: (1, a, b) of the output; a string or None if an extent is open.
        width, height: size of the model's images in pixels, 0 if open.

    Returns:
        None if the shape is ambiguous.

    >>> recognise((1, 84, 8400), 640, 640), recognise((1, 300, 6), 640, 640)
    ('yolov8', 'end_to_end')
    """
    if len(shape) != 3:
        return None
    rows, columns = shape[1:]
    cells = sum((width // stride) * (height // stride) for stride in STRIDES)
    if columns == cells and isinstance(rows, int) and rows >= 5:
        return "yolov8"
    if rows == 3 * cells and isinstance(columns, int) and columns >= 6:
        return "yolov5"
    if columns == 6 and isinstance(rows, int) and rows <= MOST_FINAL_BOXES:
        return "end_to_end"
    return None


def admits(layout: Layout, shape: Sequence[int | str | None], width: int, height: int) -> bool:
    """Whether an output can have a layout; an open extent fits every layout.

    Args: as for `recognise`.
    """
    cells = sum((width // stride) * (height // stride) for stride in STRIDES)
    expected = {
        "yolov8": (None, cells or None),
        "yolov5": (3 * cells or None, None),
        "end_to_end": (None, 6),
    }[layout]
    pairs = zip(shape[1:], expected, strict=True)
    return all(have == want for have, want in pairs if isinstance(have, int) and want is not None)


def class_names(metadata: Mapping[str, str]) -> dict[int, str]:
    """The class names that Ultralytics writes into a model; empty if there are none.

    They are parsed as a literal, never executed.

    >>> class_names({"names": "{0: 'person', 1: 'car'}"})
    {0: 'person', 1: 'car'}
    """
    try:
        names = ast.literal_eval(metadata["names"])
        if isinstance(names, list):
            names = dict(enumerate(names))
        if not isinstance(names, dict):
            return {}
        return {int(number): str(name) for number, name in names.items()}
    except (
        KeyError,
        TypeError,
        ValueError,
        SyntaxError,
        MemoryError,
        OverflowError,
        RecursionError,
    ):
        return {}


def person_class(
    model: object, names: Mapping[int, str], classes: int | None, declared: str | int | None
) -> int:
    """Choose the pedestrian class.

    Args:
        model: for the message.
        names: class names of the model by number, perhaps empty.
        classes: number of classes, None if open.
        declared: name or number of the class that a person chose, if any.

    Returns:
        The number of the class.

    Raises:
        InputError: lists the classes if none can be chosen.

    >>> person_class("model.onnx", {0: "car", 1: "Person"}, 2, None)
    1
    """
    listed = ", ".join(f"{number}: {name}" for number, name in list(names.items())[:12]) or "none"
    if isinstance(declared, int):
        if classes is not None and not 0 <= declared < classes:
            raise InputError(f"{model}: detector.person must be in [0, {classes}), got {declared}")
        return declared
    wanted = PEOPLE if declared is None else (declared.lower(),)
    for number, name in names.items():
        if name.lower() in wanted:
            if classes is not None and not 0 <= number < classes:
                raise InputError(
                    f"{model}: its metadata name class {number} {name}, but its output has only"
                    f" {classes} classes (0 to {classes - 1})"
                )
            return number
    if declared is None and classes == 1:
        return 0
    raise InputError(
        f"{model}: expected a class called {' or '.join(wanted)} among its"
        f" {classes or 'unknown number of'} classes, got names {listed};"
        " set detector.person to its number"
    )


def decode(layout: Layout, output: Any, person: int) -> tuple[Floats, Floats]:
    """Decode the output for a single image.

    Args:
        layout: of the output, not `boxes_scores`.
        output: (a, b).
        person: number of the pedestrian class.

    Returns:
        Boxes (n, 4), left, top, right, bottom in pixels of the model's image, and scores (n,).
    """
    values = np.asarray(output, np.float32)
    if layout == "end_to_end":
        classes = values[:, 5]
        # A non-finite class gets the score NaN, so the output is rejected.
        finite = np.isfinite(classes)
        people = (classes.round() == person) | ~finite
        scores = np.where(finite[people], values[people, 4], np.float32(np.nan))
        return values[people, :4], scores
    if layout == "yolov8":
        values = values.T
        scores = values[:, 4 + person]
    else:
        scores = values[:, 4] * values[:, 5 + person]
    middle, half = values[:, :2], values[:, 2:4] / 2
    return np.concatenate([middle - half, middle + half], axis=1), scores


def largest(layout: Layout, output: Any) -> float:
    """The largest coordinate of the boxes of all classes; 0 if there are none.

    Args: as for `decode`.
    """
    values = np.asarray(output, np.float32)
    boxes = (values.T if layout == "yolov8" else values)[:, :4]
    return float(np.abs(boxes).max(initial=0))


def classes_of(layout: Layout, shape: Sequence[int | str | None]) -> int | None:
    """Number of classes of an output; None if its shape leaves it open."""
    extent, others = {"yolov5": (shape[2], 5), "yolov8": (shape[1], 4)}.get(layout, (None, 0))
    return extent - others if isinstance(extent, int) else None
