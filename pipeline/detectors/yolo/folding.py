"""Normalisation with frozen statistics, folded into the kernels: a scale and a shift that then cost nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from pipeline.detectors.yolo.network import ConvUnit


class Folded(nn.Module):
    """A network in training with the frozen normalisations of its units folded into their kernels; the same output and gradients.

    dtype: of the folded kernels, which is that of the convolutions.
    """

    def __init__(self, model: nn.Module, dtype: torch.dtype) -> None:
        super().__init__()
        self.model, self._dtype = model, dtype
        frozen = [
            unit
            for unit in model.modules()
            if isinstance(unit, ConvUnit) and not unit.norm.training
        ]
        # Apart, because one parameter that needs a gradient would make all folded kernels need one.
        self._units = [
            [unit for unit in frozen if unit.convolution.weight.requires_grad is learning]
            for learning in (False, True)
        ]

    def forward(self, images: Tensor) -> Tensor:
        try:
            for units in self._units:
                _fold(units, self._dtype)
            output: Tensor = self.model(images)
            return output
        finally:
            for unit in self._units[0] + self._units[1]:
                unit.folded = None  # The next step changes the weights.


def _fold(units: Sequence[ConvUnit], dtype: torch.dtype) -> None:
    if not units:
        return
    parameters = [
        value
        for unit in units
        for value in (unit.convolution.weight, unit.norm.weight, unit.norm.bias)
    ]
    found = _Fold.apply(dtype, [unit.norm for unit in units], *parameters)  # type: ignore[no-untyped-call]
    for unit, kernel, shift in zip(units, found[0::2], found[1::2], strict=True):
        unit.folded = kernel, shift


class _Fold(torch.autograd.Function):
    """Kernel, scale and offset of each unit to its folded kernel (outputs, inputs, h, w) and shift (outputs,).

    One node of the graph for all units: left to autograd, each operation of each unit is a node, and they take a fiftieth of a step.
    """

    @staticmethod
    def forward(
        ctx: Any, dtype: torch.dtype, norms: Sequence[nn.BatchNorm2d], *parameters: Tensor
    ) -> tuple[Tensor, ...]:
        folded, kept = [], []
        for norm, kernel, weight, offset in zip(
            norms, parameters[0::3], parameters[1::3], parameters[2::3], strict=True
        ):
            assert norm.running_mean is not None and norm.running_var is not None
            inverse = (norm.running_var + norm.eps).rsqrt()
            scale = weight * inverse
            folded += [
                (kernel * _over_kernels(scale)).to(dtype),
                (offset - norm.running_mean * scale).to(dtype),
            ]
            kept += [kernel, norm.running_mean, inverse, scale]
        ctx.save_for_backward(*kept)
        return tuple(folded)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        kept, found = ctx.saved_tensors, []
        units = zip(
            gradients[0::2],
            gradients[1::2],
            kept[0::4],
            kept[1::4],
            kept[2::4],
            kept[3::4],
            strict=True,
        )
        for of_kernel, of_shift, kernel, mean, inverse, scale in units:
            of_kernel, of_shift = of_kernel.to(kernel.dtype), of_shift.to(kernel.dtype)
            of_scale = (of_kernel * kernel).sum((1, 2, 3)) - of_shift * mean
            found += [of_kernel * _over_kernels(scale), of_scale * inverse, of_shift]
        return None, None, *found


def _over_kernels(scale: Tensor) -> Tensor:
    """(outputs,) to the shape that scales (outputs, inputs, h, w)."""
    return scale[:, None, None, None]
