"""Muon: momentum whose matrices are orthogonalised before each step (Jordan et al., Muon, 2024)."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

MOMENTUM = 0.95
COEFFICIENTS = 3.4445, -4.7750, 2.0315
"""Of the quintic Newton-Schulz iteration.

The steepest at 0, so that five steps bring small singular values near 1."""
NEWTON_SCHULZ_STEPS = 5


class Muon(torch.optim.Optimizer):
    """Muon with Nesterov momentum, for (outputs, inputs) matrices.

    Unlike torch.optim.Muon, it computes in float32: processors without AVX-512 have no kernels for
    bfloat16, and a step there took longer than the rest of the iteration.

    Args:
        matrices: (outputs, inputs) each.
        lr: learning rate; a tall matrix takes sqrt(outputs / inputs) of it.
    """

    def __init__(self, matrices: Iterable[Tensor], lr: float = 1e-3) -> None:
        super().__init__(matrices, {"lr": lr})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]
        """Take a step along the gradients; there is no closure."""
        for group in self.param_groups:
            for matrix in group["params"]:
                momentum = self.state[matrix].setdefault("momentum", torch.zeros_like(matrix))
                momentum.lerp_(matrix.grad, 1 - MOMENTUM)
                update = orthogonalised(matrix.grad.lerp(momentum, MOMENTUM))
                tall = max(1.0, matrix.shape[0] / matrix.shape[1])
                matrix.add_(update, alpha=-group["lr"] * tall**0.5)


def orthogonalised(matrix: Tensor) -> Tensor:
    """About the nearest (n, m) matrix with orthonormal rows or columns.

    Its singular values are between 0.5 and 1.5.
    """
    tall = matrix.shape[0] > matrix.shape[1]
    x = matrix.T if tall else matrix
    x = x / x.norm().clamp(min=1e-7)
    a, b, c = COEFFICIENTS
    for _ in range(NEWTON_SCHULZ_STEPS):
        gram = x @ x.T
        x = torch.addmm(x, torch.addmm(gram, gram, gram, beta=b, alpha=c), x, beta=a)
    return x.T if tall else x
