"""The forward pass of a training, as fast as a processor or a GPU makes it."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import cast

import torch
from torch import Tensor, nn

from pipeline.detectors.yolo.folding import Folded
from pipeline.detectors.yolo.network import Yolo


class Forward:
    """The network in training: (n, 3, h, w) uint8 images to its output.

    It computes in bfloat16 where that is faster. On a GPU, all kernels of a forward or backward
    pass are launched at once, as a CUDA graph: singly, launching them takes ten times as long as
    they run.
    """

    def __init__(self, model: Yolo, device: torch.device) -> None:
        self._model, self._device = model, device
        # Processors without AVX-512 have no kernels for bfloat16: ten times as long an iteration.
        slow = torch.backends.cpu.get_cpu_capability() in ("DEFAULT", "AVX2")
        self._dtype = torch.float32 if device.type == "cpu" and slow else torch.bfloat16
        self._network = Folded(model, self._dtype)
        self._captured: dict[torch.Size, Callable[[Tensor], Tensor]] = {}

    def __call__(self, images: Tensor) -> Tensor:
        shown = images.to(self._dtype).div_(255)
        with torch.autocast(
            self._device.type,
            torch.bfloat16,
            enabled=self._dtype == torch.bfloat16,
            cache_enabled=False,
        ):
            if self._device.type == "cpu":
                output: Tensor = self._network(shown)
                return output
            if shown.shape not in self._captured:
                self._captured[shown.shape] = self._capture(shown)
            return self._captured[shown.shape](shown)

    def _capture(self, images: Tensor) -> Callable[[Tensor], Tensor]:
        before = {name: value.clone() for name, value in self._model.state_dict().items()}
        # Autograd waits for the gradients on the capture's stream, but warns that this takes time.
        warnings.filterwarnings("ignore", "The AccumulateGrad node's stream")
        # In a new module, because a capture replaces the forward of the module that it gets.
        captured = torch.cuda.make_graphed_callables(
            nn.Sequential(self._network), (torch.zeros_like(images),)
        )
        # The capture ran the network, which changed the normalisation's statistics.
        self._model.load_state_dict(before)
        return cast(Callable[[Tensor], Tensor], captured)
