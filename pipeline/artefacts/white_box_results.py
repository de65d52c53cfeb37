"""white_box.json: how sets of images activate the neurons of the base detector."""

from __future__ import annotations

from pipeline.artefacts.results import Result


class WhiteBoxSet(Result):
    """White-box coverage of one set of images, shares in [0, 1].

    See `pipeline.core.coverage.whitebox`.
    """

    name: str
    images: int
    neuron: float
    multisection: float
    strong: float
    top: float
    pairs: float


class WhiteBoxMeasures(Result):
    """white_box.json: the base detector's neurons and how each set of images activates them."""

    layers: int
    neurons: int
    training_images: int
    sets: tuple[WhiteBoxSet, ...]
