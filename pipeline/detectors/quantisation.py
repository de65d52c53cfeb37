"""An int8 form of an ONNX detector: convolutions in 8 bits, everything else as it was (static quantisation by ONNX Runtime)."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from pipeline.artefacts.files import write_bytes

OPERATORS = ["Conv"]


class _Images(CalibrationDataReader):  # type: ignore[misc]
    def __init__(self, images: NDArray[np.uint8]) -> None:
        self._left: Iterator[NDArray[np.uint8]] = (images[i : i + 1] for i in range(len(images)))

    def get_next(self) -> dict[str, Any] | None:
        image = next(self._left, None)
        return None if image is None else {"image": image}


def quantise(onnx: Path, images: NDArray[np.uint8], out: Path) -> None:
    """Write the int8 form of our own ONNX file. images: (n, h, w, 3) uint8 RGB, which set the ranges of the activations."""
    logging.getLogger().setLevel(logging.ERROR)  # It advises its own preprocessing, after which it was called.
    with tempfile.TemporaryDirectory() as folder:
        prepared, made = Path(folder) / "prepared.onnx", Path(folder) / "int8.onnx"
        quant_pre_process(onnx, prepared, skip_symbolic_shape=True)
        quantize_static(
            prepared,
            made,
            _Images(images),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=OPERATORS,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            calibrate_method=CalibrationMethod.MinMax,
        )
        write_bytes(out, made.read_bytes())
