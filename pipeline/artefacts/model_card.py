"""model.json, the card of a model version.

It has the origin, training data and detection quality; curve.csv is the training curve.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import pandas as pd
from pydantic import BaseModel, ConfigDict, ValidationError

from pipeline.artefacts.files import read_bytes, read_json, write_bytes, write_json
from pipeline.artefacts.results import Result
from pipeline.config.messages import message
from pipeline.core.worlds import Worlds
from pipeline.errors import InputError

RARE = "rare_"
"""Prefix of the frequencies among a card's figures."""


class Frequencies(Result):
    """How often a base set shows children and crouching people, relative to others."""

    children: float
    crouching: float

    @property
    def uniform(self) -> bool:
        """Whether all people and poses are equally frequent.

        Otherwise the base set is long-tailed.
        """
        return self.children == self.crouching == 1

    def figures(self) -> dict[str, float]:
        """Its entries in the card of a base."""
        return {f"{RARE}{name}": frequency for name, frequency in self.model_dump().items()}

    @staticmethod
    def of(figures: Mapping[str, object]) -> Frequencies | None:
        """What the `training` of a card says; None if it says nothing."""
        shown = {name: figures.get(f"{RARE}{name}") for name in Frequencies.model_fields}
        return None if None in shown.values() else Frequencies.model_validate(shown)


class ModelCard(BaseModel):
    """One model version.

    Attributes:
        data: name to digest of its training data.
        training: settings and figures of its training; for a base also `rare_children` and
            `rare_crouching`, how often its base set shows them.
        metrics: on the validation images of the base set: precision, recall, ap50, ap50_95,
            false_positives_an_image, all for visible pedestrians.
        calibration: slope and offset of the scores' logits, fitted on the same images.
        reliability: diagrams of the scores on these images, `uncalibrated` and `calibrated`: rows
            of mean score, share of correct detections, number.
        towns, people: fingerprints of all towns and populations that it or its ancestors were
            trained on; none may be held out.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: str
    parent: str | None
    architecture: dict[str, object]
    parameters: int
    input_size: tuple[int, int]
    seed: int
    data: dict[str, str]
    training: dict[str, float | str]
    metrics: dict[str, float]
    calibration: dict[str, float]
    reliability: dict[str, tuple[tuple[float, float, int], ...]]
    weights_sha256: str
    towns: tuple[str, ...]
    people: tuple[str, ...]

    @property
    def frequencies(self) -> Frequencies | None:
        """The people and poses of the base set that it was trained on.

        It is None if the card does not say.
        """
        return Frequencies.of(self.training)

    @property
    def worlds(self) -> Worlds:
        """The towns and the people that it has learnt."""
        return Worlds(frozenset(self.towns), frozenset(self.people))


@dataclass(frozen=True)
class CurvePoint:
    """One line of a training curve.

    Attributes:
        loss_scores, loss_boxes: means since the line before.
        ap50: of the averaged weights on validation images.
    """

    iteration: int
    learning_rate: float
    loss_scores: float
    loss_boxes: float
    ap50: float


CURVE = tuple(CurvePoint.__annotations__)


def write_curve(path: Path, curve: Sequence[CurvePoint]) -> None:
    """Write curve.csv."""
    table = pd.DataFrame([asdict(point) for point in curve], columns=list(CURVE))
    write_bytes(path, table.to_csv(index=False, lineterminator="\n", float_format="%.6g").encode())


def read_curve(path: Path) -> list[CurvePoint]:
    """Read curve.csv; InputError that names the file if it is not such a table."""
    try:
        table = pd.read_csv(io.BytesIO(read_bytes(path)))[list(CURVE)]
        return [
            CurvePoint(int(row[0]), *map(float, row[1:])) for row in table.itertuples(index=False)
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: expected a table with columns {','.join(CURVE)}, got {error}"
        ) from error


def write_card(path: Path, card: ModelCard) -> None:
    """Write model.json."""
    write_json(path, card.model_dump(mode="json"))


def read_card(path: Path) -> ModelCard:
    """Read model.json; InputError that names the file and key if it is missing or not a card."""
    try:
        return ModelCard.model_validate(read_json(path))
    except ValidationError as error:
        raise InputError(f"{path}: {message(error, ModelCard)}; train the version again") from error
