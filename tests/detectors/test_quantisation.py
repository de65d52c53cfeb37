"""The int8 form gives the same detections as the original."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import torch
from torch import nn

from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.quantisation import quantise
from pipeline.detectors.yolo.export import export_onnx
from pipeline.detectors.yolo.network import Architecture, Yolo
from pipeline.detectors.yolo.training import initial_model


def telling(network: Yolo) -> None:
    """Make an untrained network's scores differ between cells: without normalisation its activations fade from layer to layer."""
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = 1.0
    with torch.no_grad():
        network.train()(torch.rand(8, 3, 64, 96, generator=torch.Generator().manual_seed(0)))
        for head in network.heads:
            head[-1].weight[4].mul_(10)  # type: ignore[index, operator]
            head[-1].bias[4].zero_()  # type: ignore[index, operator]
    network.eval()


def test_quantisation_keeps_scores_and_stores_8_bit_convolutions(tmp_path: Path) -> None:
    whole, small = tmp_path / "whole.onnx", tmp_path / "int8.onnx"
    network = initial_model(3, lambda: Yolo(Architecture((8, 8, 12, 16, 16), 8))).eval()
    telling(network)
    export_onnx(whole, network, (96, 64))
    images = np.random.default_rng(0).integers(0, 255, (12, 64, 96, 3), dtype=np.uint8)
    quantise(whole, images[:8], small)
    first, second = (OnnxDetector(path, threshold=0.001, iou=0.99).detect_images(images[8:]) for path in (whole, small))
    for one, other in zip(first, second, strict=True):
        assert np.ptp(one.scores) > 0.2, "equal scores would prove nothing"
        assert abs(len(one.scores) - len(other.scores)) <= 3
        assert np.abs(one.scores[:10] - other.scores[:10]).mean() < 0.1
    model = onnx.load(str(small))
    weights = {tensor.name: tensor.data_type for tensor in model.graph.initializer}
    assert sum(kind == onnx.TensorProto.INT8 for kind in weights.values()) > 10
