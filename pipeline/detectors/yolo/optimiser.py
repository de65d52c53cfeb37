"""The optimiser: AdamW alone, or Muon for the hidden kernels and AdamW for the rest."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from pipeline.detectors.yolo.muon import Muon
from pipeline.detectors.yolo.network import ConvUnit, Yolo

MUON_FACTOR = 6.0
"""Muon's learning rate, relative to AdamW's.

At the same rate, an orthogonal step changes a kernel much less than AdamW's step."""


class Optimiser:
    """AdamW, with Muon for the hidden kernels if wanted.

    Muon orthogonalises the momentum of each kernel, seen as a matrix (outputs, inputs), so that a
    step is equally long in all directions. First, last and depthwise kernels, scales and shifts
    stay with AdamW.

    Args:
        model: the network.
        weight_decay: of the kernels that AdamW changes.
        muon: whether Muon changes the hidden kernels.
    """

    def __init__(self, model: Yolo, weight_decay: float, muon: bool) -> None:
        self._kernels = hidden_kernels(model) if muon else []
        # Channels last and a view, so that Muon's steps change the kernels; a kernel in another
        # memory format is an error here.
        self._matrices = [
            nn.Parameter(kernel.detach().permute(0, 2, 3, 1).view(len(kernel), -1))
            for kernel in self._kernels
        ]
        hidden = {id(kernel) for kernel in self._kernels}
        rest = [parameter for parameter in model.parameters() if id(parameter) not in hidden]
        kernels = [parameter for parameter in rest if parameter.ndim > 1]
        others = [parameter for parameter in rest if parameter.ndim <= 1]
        groups = [
            {"params": kernels, "weight_decay": weight_decay},
            {"params": others, "weight_decay": 0.0},
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
            matrix.grad = kernel.grad.permute(0, 2, 3, 1).reshape(matrix.shape)
            kernel.grad = None
        self._muon.step()

    def state_dict(self) -> dict[str, Any]:
        return {"adamw": self._adamw.state_dict(), "muon": self._muon and self._muon.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._adamw.load_state_dict(state["adamw"])
        if self._muon is not None:
            self._muon.load_state_dict(state["muon"])


def hidden_kernels(model: Yolo) -> list[Tensor]:
    """The kernels (outputs, inputs, h, w) of all units except the first and the depthwise ones."""
    convolutions = [unit.convolution for unit in model.modules() if isinstance(unit, ConvUnit)]
    return [each.weight for each in convolutions if each.groups == 1 and each.in_channels > 3]
