from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import save

from pipeline.detectors.yolo.folding import Folded
from pipeline.detectors.yolo.network import (
    Architecture,
    ConvUnit,
    Yolo,
    cells,
    count_parameters,
    decode,
)
from pipeline.detectors.yolo.training import initial_model
from pipeline.detectors.yolo.weights import load_weights, save_weights
from pipeline.errors import InputError

SMALL = Architecture((8, 8, 12, 16, 16), 8)


def small() -> Yolo:
    return initial_model(0, lambda: Yolo(SMALL)).eval()


def test_shapes_and_size() -> None:
    model = initial_model(0).eval()
    assert 0.9e6 < count_parameters(model) < 1.2e6
    with torch.inference_mode():
        assert model(torch.zeros(2, 3, 96, 160)).shape == (2, 5, 20 * 12 + 10 * 6 + 5 * 3)


def test_initial_weights_depend_on_the_seed_alone() -> None:
    torch.manual_seed(5)
    first, second, other = (
        initial_model(seed, lambda: Yolo(SMALL)).state_dict()["stage4.0.0.weight"]
        for seed in (1, 1, 2)
    )
    assert torch.equal(first, second)
    assert not torch.equal(first, other)


@pytest.fixture
def frozen() -> torch.nn.Sequential:
    """Two units in float64 with frozen statistics; the first does not learn."""
    units = ConvUnit(6, 8, 3, 2, groups=2), ConvUnit(8, 4, 1)
    generator = torch.Generator().manual_seed(0)
    for unit in units:
        unit.norm.eval()
        for values in (*unit.norm.parameters(), *unit.norm.buffers()):
            if values.is_floating_point():
                values.data.uniform_(0.1, 2.0, generator=generator)
    units[0].requires_grad_(False)
    return torch.nn.Sequential(*units).double()


def test_frozen_normalisation_inside_the_kernels_gives_the_same_output_and_gradients(
    frozen: torch.nn.Sequential,
) -> None:
    images = torch.rand(
        4, 6, 10, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(0)
    )

    def shown(network: torch.nn.Module) -> tuple[torch.Tensor, ...]:
        frozen.zero_grad()
        output = network(images)
        output.square().sum().backward()
        return output.detach(), *(
            parameter.grad.clone()
            for parameter in frozen.parameters()
            if parameter.grad is not None
        )

    inside, apart = shown(Folded(frozen, torch.float64)), shown(frozen)
    assert len(inside) == 4
    for values, expected in zip(inside, apart, strict=True):
        torch.testing.assert_close(values, expected)


def test_each_pass_folds_anew(frozen: torch.nn.Sequential) -> None:
    network, images = Folded(frozen, torch.float64), torch.ones(1, 6, 8, 8, dtype=torch.float64)
    before = network(images)
    second = frozen[1]
    assert isinstance(second, ConvUnit)
    with torch.no_grad():
        second.norm.weight.mul_(2)
    torch.testing.assert_close(network(images), frozen(images))
    assert not torch.equal(network(images), before)


def test_statistics_that_are_learnt_stay_outside_the_kernels() -> None:
    unit, images = ConvUnit(3, 4), torch.ones(2, 3, 8, 8)
    before = Folded(unit.eval(), torch.float32)(images)
    Folded(unit.train(), torch.float32)(images)
    assert not torch.equal(Folded(unit.eval(), torch.float32)(images), before)


def test_cells_lie_in_the_middle_of_their_squares() -> None:
    centres, strides = cells(64, 32)
    assert len(centres) == 8 * 4 + 4 * 2 + 2 * 1
    assert centres[0].tolist() == [4, 4]
    assert centres[1].tolist() == [12, 4]
    assert centres[8].tolist() == [4, 12]
    assert centres[-1].tolist() == [48, 16]
    assert strides[-1] == 32


@pytest.mark.parametrize("size", [(0, 32), (48, 32), (64, -32)])
def test_cells_refuse_other_sizes(size: tuple[int, int]) -> None:
    with pytest.raises(
        ValueError, match=f"^image sides must be positive multiples of 32, got {size[0]}x{size[1]}$"
    ):
        cells(*size)


def test_decode_by_hand() -> None:
    centres, strides = torch.tensor([[4.0, 12.0]]), torch.tensor([8.0])
    output = torch.tensor([0.5, -1.0, 0.0, torch.tensor(2.0).log().item(), -3.0]).reshape(1, 5, 1)
    boxes, logits = decode(output, centres, strides)
    assert boxes[0, 0].tolist() == pytest.approx([8 - 4, 4 - 8, 8 + 4, 4 + 8])
    assert logits.tolist() == [[-3.0]]


@pytest.mark.parametrize("widths", [(8, 8, 8, 8), (8, 8, 8, 8, 7), (0, 8, 8, 8, 8)])
def test_widths_are_checked(widths: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="^widths must be five multiples of 4, got"):
        Architecture(widths)  # type: ignore[arg-type]


def test_weights_round_trip(tmp_path: Path) -> None:
    first, second = tmp_path / "a.safetensors", tmp_path / "b.safetensors"
    save_weights(first, small())
    save_weights(second, load_weights(first))
    assert first.read_bytes() == second.read_bytes()
    assert load_weights(first).architecture == SMALL


def test_shipped_size_is_below_three_megabytes(tmp_path: Path) -> None:
    save_weights(tmp_path / "w.safetensors", initial_model(0))
    assert (tmp_path / "w.safetensors").stat().st_size < 3e6


def test_wrong_weight_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    with pytest.raises(
        InputError,
        match=r"w\.safetensors: expected the weights of a detector \(weights\.safetensors\),"
        " found no file",
    ):
        load_weights(path)
    save_weights(path, small())
    whole = path.read_bytes()
    plain = json.dumps({"widths": SMALL.widths, "head": SMALL.head})
    foreign, tensors = r"w\.safetensors holds no Blindspot detector", {"x": torch.zeros(1)}
    wrong = [
        (b"", foreign),
        (b"text", foreign),
        (whole[:-100], foreign),
        (save(tensors), foreign),
        (save(tensors, {"architecture": "[]"}), foreign),
        (
            save(tensors, {"architecture": plain}),
            r"w\.safetensors: expected the \d+ tensors of our network;"
            " '.+' is missing or unexpected",
        ),
    ]
    for data, message in wrong:
        path.write_bytes(data)
        with pytest.raises(InputError, match=message):
            load_weights(path)
