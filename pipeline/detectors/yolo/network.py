"""A small YOLO-style network.

CSP backbone, SPPF, PAN neck, anchor-free heads at strides 8, 16 and 32.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

STRIDES = (8, 16, 32)
CHANNELS = 5
"""Outputs per cell: centre offset (2) and log size (2) in strides, and a pedestrian's logit."""
MAX_LOG_SIZE = 5.0


@dataclass(frozen=True)
class Architecture:
    """The shape of the network.

    Args:
        widths: channels at strides 2, 4, 8, 16 and 32, multiples of 4.
        head: channels of a head, at least 4.

    Raises:
        ValueError: if a number of channels does not fit.
    """

    widths: tuple[int, int, int, int, int] = (16, 32, 48, 96, 144)
    head: int = 48

    def __post_init__(self) -> None:
        if len(self.widths) != 5 or min(self.widths) < 4 or any(width % 4 for width in self.widths):
            raise ValueError(f"widths must be five multiples of 4, got {self.widths}")
        if self.head < 4:
            raise ValueError(f"head must be at least 4, got {self.head}")


SIZES = {"nano": Architecture(), "small": Architecture((24, 48, 80, 144, 224), 64)}
"""1.1 and 2.6 million parameters."""


class ConvUnit(nn.Sequential):
    """Convolution, batch normalisation and ReLU, which a CPU trains faster than SiLU.

    folded: a kernel and a shift that stand for convolution and normalisation while they are set.
    """

    folded: tuple[Tensor, Tensor] | None = None

    def __init__(
        self, inputs: int, outputs: int, kernel: int = 3, stride: int = 1, groups: int = 1
    ) -> None:
        padding = kernel // 2
        super().__init__(
            nn.Conv2d(inputs, outputs, kernel, stride, padding, groups=groups, bias=False),
            nn.BatchNorm2d(outputs, eps=1e-3, momentum=0.03),
            nn.ReLU(inplace=True),
        )

    @property
    def convolution(self) -> nn.Conv2d:
        convolution = self[0]
        assert isinstance(convolution, nn.Conv2d)
        return convolution

    @property
    def norm(self) -> nn.BatchNorm2d:
        norm = self[1]
        assert isinstance(norm, nn.BatchNorm2d)
        return norm

    def forward(self, x: Tensor) -> Tensor:
        if self.folded is None:
            y: Tensor = super().forward(x)  # type: ignore[no-untyped-call]
            return y
        conv = self.convolution
        return functional.conv2d(
            x, *self.folded, conv.stride, conv.padding[0], groups=conv.groups
        ).relu_()


class Csp(nn.Module):
    """Cross-stage partial block.

    Half of the channels pass through `depth` bottlenecks, and every stage is kept.
    """

    def __init__(self, inputs: int, outputs: int, depth: int = 1, residual: bool = True) -> None:
        super().__init__()
        self.part = half = outputs // 2
        self.enter = ConvUnit(inputs, outputs, 1)
        self.stages = nn.ModuleList(
            nn.Sequential(ConvUnit(half, half), ConvUnit(half, half)) for _ in range(depth)
        )
        self.leave = ConvUnit(outputs + half * depth, outputs, 1)
        self.residual = residual

    def forward(self, x: Tensor) -> Tensor:
        kept = list(self.enter(x).split(self.part, 1))
        for stage in self.stages:
            kept.append(kept[-1] + stage(kept[-1]) if self.residual else stage(kept[-1]))
        left: Tensor = self.leave(torch.cat(kept, 1))
        return left


class Sppf(nn.Module):
    """Spatial pyramid pooling, the fast form: three 5x5 poolings in a row see 5, 9 and 13 cells."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.enter = ConvUnit(channels, channels // 2, 1)
        self.pool = nn.MaxPool2d(5, 1, 2)
        self.leave = ConvUnit(channels * 2, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        kept = [self.enter(x)]
        for _ in range(3):
            kept.append(self.pool(kept[-1]))
        left: Tensor = self.leave(torch.cat(kept, 1))
        return left


class Yolo(nn.Module):
    """The network.

    It takes (n, 3, h, w) in [0, 1], h and w multiples of 32, and returns (n, `CHANNELS`, cells),
    cells of stride 8 first.
    """

    def __init__(self, architecture: Architecture | None = None) -> None:
        super().__init__()
        self.architecture = architecture or Architecture()
        w2, w4, w8, w16, w32 = self.architecture.widths
        self.stage4 = nn.Sequential(ConvUnit(3, w2, 3, 2), ConvUnit(w2, w4, 3, 2), Csp(w4, w4))
        self.stage8 = nn.Sequential(ConvUnit(w4, w8, 3, 2), Csp(w8, w8, 2))
        self.stage16 = nn.Sequential(ConvUnit(w8, w16, 3, 2), Csp(w16, w16, 2))
        self.stage32 = nn.Sequential(ConvUnit(w16, w32, 3, 2), Csp(w32, w32), Sppf(w32))
        self.upsample = nn.Upsample(scale_factor=2, mode="nearest")
        self.up16 = Csp(w32 + w16, w16, residual=False)
        self.up8 = Csp(w16 + w8, w8, residual=False)
        self.down8 = ConvUnit(w8, w8, 3, 2)
        self.down16 = Csp(w8 + w16, w16, residual=False)
        self.down16_to_32 = ConvUnit(w16, w16, 3, 2)
        self.down32 = Csp(w16 + w32, w32, residual=False)
        self.heads = nn.ModuleList(_head(width, self.architecture.head) for width in (w8, w16, w32))

    def forward(self, x: Tensor) -> Tensor:
        p8 = self.stage8(self.stage4(x))
        p16 = self.stage16(p8)
        p32 = self.stage32(p16)
        n16 = self.up16(torch.cat([self.upsample(p32), p16], 1))
        n8 = self.up8(torch.cat([self.upsample(n16), p8], 1))
        n16 = self.down16(torch.cat([self.down8(n8), n16], 1))
        n32 = self.down32(torch.cat([self.down16_to_32(n16), p32], 1))
        levels = zip(self.heads, (n8, n16, n32), strict=True)
        return torch.cat([head(level).flatten(2) for head, level in levels], 2)


def cells(width: int, height: int) -> tuple[Tensor, Tensor]:
    """The cells of the network's output for an image size in pixels.

    Returns:
        Centres (cells, 2) in pixels, and strides (cells,).

    Raises:
        ValueError: unless both sides are positive multiples of 32.

    >>> centres, strides = cells(32, 32)
    >>> len(centres), centres[-1].tolist(), float(strides[-1])
    (21, [16.0, 16.0], 32.0)
    """
    if width <= 0 or height <= 0 or width % STRIDES[-1] or height % STRIDES[-1]:
        raise ValueError(
            f"image sides must be positive multiples of {STRIDES[-1]}, got {width}x{height}"
        )
    centres, strides = [], []
    for stride in STRIDES:
        x = (torch.arange(width // stride) + 0.5) * stride
        y = (torch.arange(height // stride) + 0.5) * stride
        grid = torch.stack(torch.meshgrid(x, y, indexing="xy"), -1).reshape(-1, 2)
        centres.append(grid)
        strides.append(torch.full((len(grid),), float(stride)))
    return torch.cat(centres), torch.cat(strides)


def decode(output: Tensor, centres: Tensor, strides: Tensor) -> tuple[Tensor, Tensor]:
    """Decode the network's output.

    Args:
        output: (n, `CHANNELS`, cells).
        centres, strides: from `cells`.

    Returns:
        Boxes (n, cells, 4), left, top, right, bottom in pixels, and logits (n, cells).
    """
    values = output.float()
    middle = centres.T + values[:, 0:2] * strides
    half = values[:, 2:4].clamp(max=MAX_LOG_SIZE).exp() * (strides / 2)
    return torch.cat([middle - half, middle + half], 1).transpose(1, 2), values[:, 4]


def count_parameters(model: nn.Module) -> int:
    """Number of parameters."""
    return sum(parameter.numel() for parameter in model.parameters())


def _head(inputs: int, width: int) -> nn.Sequential:
    last = nn.Conv2d(width, CHANNELS, 1)
    with torch.no_grad():
        # A person is about twice as tall as wide; each cell starts near the size of its stride and
        # at a score of 1 in 100.
        assert last.bias is not None
        last.bias.copy_(torch.tensor([0.0, 0.0, math.log(1.2), math.log(2.4), -math.log(99.0)]))
        last.weight.mul_(0.1)
    return nn.Sequential(
        ConvUnit(inputs, width),
        ConvUnit(width, width, groups=width),
        ConvUnit(width, width, 1),
        last,
    )
