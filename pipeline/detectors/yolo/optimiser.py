"""The optimiser: AdamW alone, or Muon for the hidden kernels and AdamW for the rest."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from pipeline.detectors.yolo.muon import Muon
from pipeline.detectors.yolo.network import ConvUnit, Yolo

MUON_FACTOR = 6.0
"""Muon's learning rate, relative to AdamW's: an orthogonal step changes a kernel much less than AdamW's step of the same rate."""


class Optimiser:
    """Muon orthogonalises the momentum of each kernel, seen as a matrix (outputs, inputs), so that a step is equally long in all of its
    directions. First, last and depthwise kernels, scales and shifts stay with AdamW.
    """

    def __init__(self, model: Yolo, weight_decay: float, muon: bool) -> None:
        self._kernels = hidden_kernels(model) if muon else []
        # Views, so that Muon's steps change the kernels; a kernel in another memory format is an error here.
        self._matrices = [
            nn.Parameter(_channels_last(kernel.detach()).view(len(kernel), -1))
            for kernel in self._kernels
        ]
        hidden = {id(kernel) for kernel in self._kernels}
        rest = [parameter for parameter in model.parameters() if id(parameter) not in hidden]
        groups = [
            {
                "params": [parameter for parameter in rest if parameter.ndim > 1],
                "weight_decay": weight_decay,
            },
            {
                "params": [parameter for parameter in rest if parameter.ndim <= 1],
                "weight_decay": 0.0,
            },
        ]
        self._adamw = torch.optim.AdamW(groups, fused=True)
        self._muon = Muon(self._matrices) if muon else None

    def step(self, rate: float) -> None:
        """Take a step at AdamW's learning rate `rate` along the gradients, and clear them."""
        for group in self._adamw.param_groups:
            group["lr"] = rate
        self._adamw.step()
        self._adamw.zero_grad(set_to_none=True)
        if self._muon is None:
            return
        for group in self._muon.param_groups:
            group["lr"] = MUON_FACTOR * rate
        for kernel, matrix in zip(self._kernels, self._matrices, strict=True):
            assert kernel.grad is not None
            matrix.grad, kernel.grad = _channels_last(kernel.grad).reshape(matrix.shape), None
        self._muon.step()

    def state_dict(self) -> dict[str, Any]:
        return {"adamw": self._adamw.state_dict(), "muon": self._muon and self._muon.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._adamw.load_state_dict(state["adamw"])
        if self._muon is not None:
            self._muon.load_state_dict(state["muon"])


def hidden_kernels(model: Yolo) -> list[Tensor]:
    """The kernels (outputs, inputs, h, w) of all convolution units except the first and the depthwise ones."""
    convolutions = [unit.convolution for unit in model.modules() if isinstance(unit, ConvUnit)]
    return [one.weight for one in convolutions if one.groups == 1 and one.in_channels > 3]


def _channels_last(kernel: Tensor) -> Tensor:
    """(outputs, inputs, h, w) to (outputs, h, w, inputs)."""
    return kernel.permute(0, 2, 3, 1)
