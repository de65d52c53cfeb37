"""Foreign ONNX detectors: outputs in the layouts of their makers, and models that return them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

WIDTH, HEIGHT = 160, 96
CELLS = sum((WIDTH // s) * (HEIGHT // s) for s in (8, 16, 32))
NAMES = "{0: 'person', 1: 'bicycle', 2: 'car'}"


def export(
    path: Path,
    output: np.ndarray,
    names: str | None = NAMES,
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> Path:
    """A model with the same output for every image: a constant plus zero times the image's mean."""
    constant = numpy_helper.from_array(output.astype(np.float32), "constant")
    zero = numpy_helper.from_array(np.zeros((1, 1, 1), np.float32), "zero")
    axes = numpy_helper.from_array(np.array([1, 2, 3]), "axes")
    squeeze = numpy_helper.from_array(np.array([3]), "squeeze")
    nodes = [
        helper.make_node("ReduceMean", ["images", "axes"], ["mean4"], keepdims=1),
        helper.make_node("Squeeze", ["mean4", "squeeze"], ["mean"]),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
        helper.make_node("Add", ["constant", "nothing"], ["output0"]),
    ]
    inputs = [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, size[1], size[0]])]
    outputs = [helper.make_tensor_value_info("output0", TensorProto.FLOAT, list(output.shape))]
    graph = helper.make_graph(nodes, "model", inputs, outputs, [constant, zero, axes, squeeze])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    if names:
        helper.set_model_props(model, {"names": names})
    onnx.save(model, path)
    return path


def yolov8(classes: int = 3) -> np.ndarray:
    """A person at (40, 30) to (60, 70), a car elsewhere, and a weaker duplicate of the person."""
    output = np.zeros((1, 4 + classes, CELLS), np.float32)
    output[0, :, 7] = [50, 50, 20, 40, 0.9, *[0.0] * (classes - 1)]
    output[0, :, 8] = [51, 50, 20, 40, 0.6, *[0.0] * (classes - 1)]
    if classes > 2:
        output[0, :, 90] = [120, 60, 30, 20, 0.1, 0.1, 0.95]
    return output


def yolov5() -> np.ndarray:
    """The same person and car as boxes with an objectness."""
    output = np.zeros((1, 3 * CELLS, 8), np.float32)
    output[0, 11] = [50, 50, 20, 40, 0.95, 0.9, 0, 0]
    output[0, 90] = [120, 60, 30, 20, 0.99, 0, 0, 0.99]
    return output


def end_to_end() -> np.ndarray:
    """The same person and car as final boxes: left, top, right, bottom, score, class."""
    output = np.zeros((1, 100, 6), np.float32)
    output[0, 0] = [40, 30, 60, 70, 0.9, 0]
    output[0, 1] = [100, 50, 140, 70, 0.95, 2]
    return output
