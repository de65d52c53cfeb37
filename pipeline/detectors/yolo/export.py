"""Exports weights to ONNX: uint8 images in, boxes in pixels and scores out.

Only non-maximum suppression stays outside.
"""

from __future__ import annotations

import hashlib
import tempfile
import warnings
from pathlib import Path

import torch
from torch import Tensor, nn

from pipeline.artefacts.files import sha256, write_bytes
from pipeline.artefacts.model_card import read_card
from pipeline.core.reliability import Calibration
from pipeline.detectors.yolo.network import Yolo, cells, decode
from pipeline.detectors.yolo.weights import load_weights
from pipeline.errors import InputError

OPSET = 17
DIGITS = 16
"""Of a digest, in the name of an exported file."""


class Deployed(nn.Module):
    """The network with normalisation and decoding included, for one image size (w, h)."""

    centres: Tensor
    strides: Tensor

    def __init__(self, model: Yolo, size: tuple[int, int], calibration: Calibration) -> None:
        super().__init__()
        self.model, self.calibration = model, calibration
        centres, strides = cells(*size)
        self.register_buffer("centres", centres)
        self.register_buffer("strides", strides)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Images (n, h, w, 3) to boxes (n, cells, 4) in pixels and scores (n, cells) in [0, 1]."""
        scaled = image.permute(0, 3, 1, 2).float() * (1 / 255)
        boxes, logits = decode(self.model(scaled), self.centres, self.strides)
        return boxes, (self.calibration.slope * logits + self.calibration.offset).sigmoid()


def onnx_of(model: Path, folder: Path) -> Path:
    """The ONNX file of a version.

    If missing, it is exported and named by the digest of weights and card, so that versions never
    overwrite each other.

    Args:
        model: folder of the version.
        folder: for an exported file.

    Raises:
        InputError: if it is not the folder of a version.
    """
    if model.is_file():
        advice = ""
        if any((model.parent / name).exists() for name in ("model.onnx", "weights.safetensors")):
            advice = f"; name {model.parent}"
        raise InputError(f"{model}: expected the folder of a version, got a file{advice}")
    if (model / "model.onnx").exists():
        return model / "model.onnx"
    weights, card = model / "weights.safetensors", model / "model.json"
    if not weights.exists():
        raise InputError(f"{model} holds neither model.onnx nor weights.safetensors")
    name = hashlib.sha256(f"{sha256(weights)} {sha256(card)}".encode()).hexdigest()[:DIGITS]
    export_version(weights, card, folder / f"{name}.onnx")
    return folder / f"{name}.onnx"


def export_version(weights: Path, card: Path, onnx: Path) -> None:
    """Write the ONNX file of a version, with the image size and calibration of its card."""
    described = read_card(card)
    calibration = Calibration(**described.calibration)
    export_onnx(onnx, load_weights(weights), described.input_size, calibration)


def export_onnx(
    path: Path, model: Yolo, size: tuple[int, int], calibration: Calibration | None = None
) -> None:
    """Write a network as ONNX; the same weights and calibration give the same bytes.

    Args:
        path: of the file.
        model: the network.
        size: width and height of the images, of which the file takes any number at a time.
        calibration: of the scores; None for none.
    """
    example = torch.zeros(1, size[1], size[0], 3, dtype=torch.uint8)
    axes = {name: {0: "images"} for name in ("image", "boxes", "scores")}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        exported = Path(folder) / "model.onnx"
        # The newer exporter needs another package, onnxscript.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            Deployed(model, size, calibration or Calibration()).eval(),
            (example,),
            exported,
            input_names=["image"],
            output_names=["boxes", "scores"],
            dynamic_axes=axes,
            opset_version=OPSET,
            dynamo=False,
        )
        write_bytes(path, exported.read_bytes())
