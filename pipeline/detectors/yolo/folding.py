"""Normalisation with frozen statistics, folded into the kernels, where it costs nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import torch
from torch import Tensor, nn

from pipeline.detectors.yolo.network import ConvUnit

Fold = Callable[..., tuple[Tensor, ...]]


class Folded(nn.Module):
    """A network in training whose frozen normalisations are folded into the kernels.

    Output and gradients stay the same.

    Args:
        model: the network.
        dtype: of the folded kernels, which is that of the convolutions.
    """

    def __init__(self, model: nn.Module, dtype: torch.dtype) -> None:
        super().__init__()
        self.model, self._dtype = model, dtype
        # Apart, because a parameter that needs a gradient would make all folded kernels need one.
        self._units: dict[bool, list[ConvUnit]] = {False: [], True: []}
        for unit in model.modules():
            if isinstance(unit, ConvUnit) and not unit.norm.training:
                self._units[unit.convolution.weight.requires_grad].append(unit)

    def forward(self, images: Tensor) -> Tensor:
        try:
            for units in self._units.values():
                parameters = []
                for unit in units:
                    parameters += [unit.convolution.weight, unit.norm.weight, unit.norm.bias]
                norms, fold = [unit.norm for unit in units], cast(Fold, _Fold.apply)
                folded = fold(self._dtype, norms, *parameters) if units else ()
                for unit, kernel, shift in zip(units, folded[0::2], folded[1::2], strict=True):
                    unit.folded = kernel, shift
            output: Tensor = self.model(images)
            return output
        finally:
            for unit in self._units[False] + self._units[True]:
                unit.folded = None  # The next step changes the weights.


class _Fold(torch.autograd.Function):
    """Kernel, scale and offset of each unit to its folded kernel and shift.

    Kernels are (outputs, inputs, h, w), the others (outputs,). A single node of the graph for all
    units: left to autograd, each operation of each unit is a node, and they take a fiftieth of a
    step.
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
            folded.append((kernel * scale[:, None, None, None]).to(dtype))
            folded.append((offset - norm.running_mean * scale).to(dtype))
            kept += [kernel, norm.running_mean, inverse, scale]
        ctx.save_for_backward(*kept)
        return tuple(folded)

    @staticmethod
    def backward(  # type: ignore[override]
        ctx: Any, *gradients: Tensor
    ) -> tuple[Tensor | None, ...]:
        kept, result = [ctx.saved_tensors[start::4] for start in range(4)], []
        units = zip(gradients[0::2], gradients[1::2], *kept, strict=True)
        for of_kernel, of_shift, kernel, mean, inverse, scale in units:
            of_kernel, of_shift = of_kernel.to(kernel.dtype), of_shift.to(kernel.dtype)
            of_scale = (of_kernel * kernel).sum((1, 2, 3)) - of_shift * mean
            result += [of_kernel * scale[:, None, None, None], of_scale * inverse, of_shift]
        return None, None, *result
