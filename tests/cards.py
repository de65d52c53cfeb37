"""A model card for tests."""

from __future__ import annotations

from pipeline.artefacts.model_card import ModelCard

CARD = ModelCard(
    version="random",
    parent="base",
    architecture={"widths": [8, 8, 8, 8, 8], "head": 8},
    parameters=1000,
    input_size=(320, 192),
    seed=0,
    data={"base_set": "ab", "added": "cd"},
    training={"iterations": 5.0},
    metrics={"ap50": 0.9},
    calibration={"slope": 2.0, "offset": 0.5},
    reliability={"calibrated": ((0.2, 0.3, 20), (0.9, 0.85, 80))},
    weights_sha256="ef",
    towns=("0123456789abcdef",),
    people=("fedcba9876543210",),
)
