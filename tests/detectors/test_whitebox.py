"""White-box coverage by hand, and for the shipped detector."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.coverage.whitebox import SECTIONS, Profile, WhiteBox
from pipeline.detectors.yolo.activations import activations
from pipeline.detectors.yolo.weights import load_weights

ROOT = Path(__file__).resolve().parents[2]


def layer(*rows: tuple[float, ...]) -> np.ndarray:
    return np.array(rows, np.float32)


def test_every_measure_by_hand() -> None:
    # Two layers: three neurons with training ranges 0 to 1, 0 to 2 and 0 to 4; and one with a
    # constant activation.
    profile = Profile.of([layer((0, 0, 0), (1, 2, 4)), layer((0.0,), (0.0,))])
    box = WhiteBox(profile)
    box.show([layer((0.95, 0, 0), (0.05, 2.5, 0)), layer((0.0,), (0.0,))])
    coverage = box.coverage()
    assert coverage.neuron == 2 / 4
    # 0.95 and 0.05 of the first, 0 of the second (2.5 lies above its range), 0 of the third.
    assert coverage.multisection == 4 / (3 * SECTIONS)
    assert coverage.strong == 1 / 3
    assert coverage.top == 2 / 4  # Among a layer's two most active, if active at all.
    assert coverage.pairs == 1 / 3  # The first two were active together.


def test_batches_accumulate_and_more_images_never_cover_less() -> None:
    rng = np.random.default_rng(0)
    training, shown = rng.random((50, 6), np.float32) - 0.3, rng.random((40, 6), np.float32) - 0.3
    whole, parts = WhiteBox(Profile.of([training])), WhiteBox(Profile.of([training]))
    whole.show([shown])
    before = None
    for i in range(0, 40, 8):
        parts.show([shown[i : i + 8]])
        now = parts.coverage()
        assert before is None or all(vars(now)[name] >= vars(before)[name] for name in vars(now))
        before = now
    assert before == whole.coverage()
    joined = Profile.of([training[:20]]).joined(Profile.of([training[20:]]))
    assert all(
        (a == b).all() for a, b in zip(joined.high, Profile.of([training]).high, strict=True)
    )


def test_the_shipped_detector_gives_its_activations() -> None:
    network = load_weights(ROOT / "models" / "uniform" / "weights.safetensors")
    images = np.random.default_rng(0).integers(0, 256, (20, 96, 160, 3), np.uint8)
    batches = list(activations(network, images))
    layers = [np.concatenate(values) for values in zip(*batches, strict=True)]
    assert all(len(values) == 20 and (values >= 0).all() for values in layers) and len(layers) > 30
    box = WhiteBox(Profile.of(layers))
    box.show(layers)
    coverage = box.coverage()
    # On the training images themselves, every neuron that varies reaches its training maximum.
    assert (
        coverage.strong == pytest.approx(1) and 0 < coverage.neuron <= 1 and 0 < coverage.pairs <= 1
    )
