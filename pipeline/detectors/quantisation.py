"""The int8 form of an ONNX detector: convolutions in 8 bits, except the last ones of the heads.

ONNX Runtime quantises statically. The last convolutions output offsets, sizes and scores together,
whose ranges differ too much for one scale of 8 bits.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)
from onnxruntime.quantization.shape_inference import quant_pre_process

from pipeline.artefacts.files import write_bytes

OPERATORS = ["Conv"]


class _Images(CalibrationDataReader):  # type: ignore[misc]
    def __init__(self, images: NDArray[np.uint8]) -> None:
        self._left: Iterator[NDArray[np.uint8]] = (images[i : i + 1] for i in range(len(images)))

    def get_next(self) -> dict[str, Any] | None:
        image = next(self._left, None)
        return None if image is None else {"image": image}


def quantise(whole: Path, images: NDArray[np.uint8], out: Path) -> None:
    """Write the int8 form of one of our ONNX files.

    Args:
        whole: the file.
        images: (n, h, w, 3) uint8 RGB, which set the ranges of the activations.
        out: the file to write.
    """
    logger = logging.getLogger()
    level = logger.level
    # ONNX Runtime recommends its preprocessing although that has already run.
    logger.setLevel(logging.ERROR)
    try:
        with tempfile.TemporaryDirectory() as folder:
            prepared, quantised = Path(folder) / "prepared.onnx", Path(folder) / "int8.onnx"
            quant_pre_process(whole, prepared, skip_symbolic_shape=True)
            quantize_static(
                prepared,
                quantised,
                _Images(images),
                quant_format=QuantFormat.QDQ,
                op_types_to_quantize=OPERATORS,
                nodes_to_exclude=_last_convolutions(prepared),
                per_channel=True,
                activation_type=QuantType.QUInt8,
                weight_type=QuantType.QInt8,
                calibrate_method=CalibrationMethod.MinMax,
            )
            write_bytes(out, quantised.read_bytes())
    finally:
        logger.setLevel(level)


def _last_convolutions(path: Path) -> list[str]:
    """Names of the convolutions that no other convolution follows."""
    graph = onnx.load(str(path)).graph
    readers: dict[str, list[Any]] = {}
    for node in graph.node:
        for name in node.input:
            readers.setdefault(name, []).append(node)
    feeds: dict[str, bool] = {}
    for node in reversed(graph.node):  # Nodes come in the order of computation.
        behind = [reader for name in node.output for reader in readers.get(name, ())]
        feeds[node.name] = any(reader.op_type == "Conv" or feeds[reader.name] for reader in behind)
    return [node.name for node in graph.node if node.op_type == "Conv" and not feeds[node.name]]
