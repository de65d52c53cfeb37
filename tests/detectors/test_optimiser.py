from __future__ import annotations

import pytest
import torch
from torch import Tensor

from pipeline.detectors.yolo.muon import Muon, orthogonalised
from pipeline.detectors.yolo.network import Architecture, Yolo
from pipeline.detectors.yolo.optimiser import MUON_FACTOR, Optimiser, hidden_kernels
from pipeline.detectors.yolo.training import initial_model

RATE = 1e-3


def model() -> Yolo:
    model = initial_model(0, lambda: Yolo(Architecture((8, 8, 12, 16, 16), 8)))
    return model.to(memory_format=torch.channels_last)  # type: ignore[call-overload, no-any-return]


def changes(network: Yolo, muon: bool) -> dict[str, Tensor]:
    """Change of each parameter in one step along random gradients, without weight decay."""
    before = {name: parameter.detach().clone() for name, parameter in network.named_parameters()}
    generator = torch.Generator().manual_seed(1)
    for parameter in network.parameters():
        parameter.grad = torch.randn(parameter.shape, generator=generator)
    Optimiser(network, 0.0, muon).step(RATE)
    assert all(parameter.grad is None for parameter in network.parameters())
    return {
        name: parameter.detach() - before[name] for name, parameter in network.named_parameters()
    }


@pytest.mark.parametrize("shape", [(6, 40), (40, 6), (16, 16)])
def test_orthogonalised_keeps_the_directions_and_evens_their_lengths(
    shape: tuple[int, int],
) -> None:
    matrix = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    left, _, right = torch.linalg.svd(matrix, full_matrices=False)
    rotated = left.T @ orthogonalised(matrix) @ right.T
    assert (rotated - torch.diag(rotated.diag())).abs().max() < 1e-4
    assert rotated.diag().min() > 0.4 and rotated.diag().max() < 1.5


def test_muon_takes_the_steps_of_torch() -> None:
    start, generator = (
        torch.randn(8, 20, generator=torch.Generator().manual_seed(0)),
        torch.Generator().manual_seed(1),
    )
    ours, theirs = torch.nn.Parameter(start.clone()), torch.nn.Parameter(start.clone())
    steps = Muon([ours], lr=0.1), torch.optim.Muon([theirs], lr=0.1, weight_decay=0.0)
    for _ in range(5):
        ours.grad = torch.randn(8, 20, generator=generator)
        theirs.grad = ours.grad.clone()
        for optimiser in steps:
            optimiser.step()  # type: ignore[no-untyped-call]
    torch.testing.assert_close(ours, theirs, atol=0.02, rtol=0.02)  # torch computes in bfloat16.


def test_hidden_kernels_leave_out_first_last_and_depthwise_ones() -> None:
    network = model()
    hidden = {id(kernel) for kernel in hidden_kernels(network)}
    others = {
        name
        for name, parameter in network.named_parameters()
        if parameter.ndim > 1 and id(parameter) not in hidden
    }
    heads = {f"heads.{level}.{part}" for level in range(3) for part in ("1.0.weight", "3.weight")}
    assert others == {"stage4.0.0.weight"} | heads


def test_without_muon_every_parameter_takes_a_first_step_of_adam() -> None:
    for change in changes(model(), muon=False).values():
        assert change.abs().max() == pytest.approx(RATE, rel=0.01)


def test_a_step_of_muon_is_about_equally_long_in_all_directions() -> None:
    network = model()
    kernels = set(map(id, hidden_kernels(network)))
    hidden = {name for name, value in network.named_parameters() if id(value) in kernels}
    for name, change in changes(network, muon=True).items():
        if name not in hidden:
            assert change.abs().max() == pytest.approx(RATE, rel=0.01)
            continue
        matrix = change.permute(0, 2, 3, 1).flatten(1)
        # Tall matrices take sqrt(outputs / inputs) of the rate; five Newton-Schulz steps bring
        # singular values near 1, not to it.
        lengths = torch.linalg.svdvals(matrix) / (
            MUON_FACTOR * RATE * max(1, matrix.shape[0] / matrix.shape[1]) ** 0.5
        )
        assert 0.4 < lengths.median() < 1.4 and lengths.max() < 1.5
