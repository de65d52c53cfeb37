"""The state of a training and its checkpoint, from which a killed run resumes.

With the same number of threads on the same kind of processor, it resumes with the same bits.
"""

from __future__ import annotations

import io
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from pipeline.artefacts.files import read_sealed, write_sealed
from pipeline.artefacts.model_card import CurvePoint
from pipeline.detectors.yolo.network import Yolo
from pipeline.detectors.yolo.optimiser import Optimiser
from pipeline.errors import InputError


@dataclass
class State:
    """The content of a checkpoint.

    Attributes:
        iteration: number of iterations done.
        model: the network in training.
        average: the network with averaged weights.
        optimiser: of the model.
        best: the averaged weights of the best evaluation.
        sums: (2,) sums of both losses since the last evaluation.
        curve: a point for each evaluation.
    """

    iteration: int
    model: Yolo
    average: Yolo
    optimiser: Optimiser
    best: dict[str, Tensor]
    sums: Tensor
    curve: list[CurvePoint]

    @cached_property
    def parameters(self) -> list[Tensor]:
        """Of the network in training."""
        return list(self.model.parameters())

    @cached_property
    def averaging(self) -> tuple[list[Tensor], list[Tensor]]:
        """The averaged weights and those that they follow.

        They share the networks' memory; listing them takes as long as averaging.
        """
        averages, weights = self.average.state_dict().values(), self.model.state_dict().values()
        return (
            [value for value in averages if value.is_floating_point()],
            [value for value in weights if value.is_floating_point()],
        )

    def exhausted(self, patience: int) -> bool:
        """Whether the last `patience` evaluations gave no new best."""
        scores = [point.ap50 for point in self.curve]
        return bool(scores) and len(scores) - 1 - int(np.argmax(scores)) >= patience


def save(path: Path, identity: str, state: State) -> None:
    """Write the checkpoint.

    Args:
        path: of the file.
        identity: digest of the training that it belongs to.
        state: the content.
    """
    buffer = io.BytesIO()
    content = {
        "identity": identity,
        "iteration": state.iteration,
        "model": state.model.state_dict(),
        "average": state.average.state_dict(),
        "optimiser": state.optimiser.state_dict(),
        "best": state.best,
        "sums": state.sums,
        "curve": [asdict(point) for point in state.curve],
    }
    torch.save(content, buffer)
    write_sealed(path, buffer.getvalue())


def resume(path: Path, identity: str, state: State, device: torch.device) -> None:
    """Put the content of the checkpoint into a state.

    A damaged checkpoint, or one of another training, is ignored.

    Args:
        path: of the file.
        identity: digest of the training.
        state: changed in place.
        device: to which the tensors are loaded.
    """
    try:
        content = torch.load(io.BytesIO(read_sealed(path)), map_location=device, weights_only=True)
    except InputError:
        return
    if content["identity"] != identity:
        return
    state.model.load_state_dict(content["model"])
    state.average.load_state_dict(content["average"])
    state.optimiser.load_state_dict(content["optimiser"])
    state.best, state.sums = content["best"], content["sums"]
    state.curve = [CurvePoint(**point) for point in content["curve"]]
    state.iteration = int(content["iteration"])
