"""Untrained networks for tests."""

from __future__ import annotations

import torch
from torch import nn

from pipeline.detectors.yolo.network import Architecture, Yolo
from pipeline.detectors.yolo.training import initial_model


def small_network() -> Yolo:
    """An untrained network of few channels."""
    return initial_model(0, lambda: Yolo(Architecture((8, 16, 16, 24, 32), 16)))


def spread_scores(network: Yolo) -> None:
    """Make an untrained network's scores differ between cells.

    Without normalisation its activations fade from layer to layer.
    """
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = 1.0
    with torch.no_grad():
        network.train()(torch.rand(8, 3, 64, 96, generator=torch.Generator().manual_seed(0)))
        for head in network.heads:
            head[-1].weight[4].mul_(10)  # type: ignore[index, operator]
            head[-1].bias[4].zero_()  # type: ignore[index, operator]
    network.eval()
