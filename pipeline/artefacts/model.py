"""model.json, the card of a model version: where it comes from, what it was trained on and how well it detects."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from pipeline.artefacts.files import read_json, write_json
from pipeline.protocols import InputError


class ModelCard(BaseModel):
    """One model version.

    data: name to digest of what it was trained on. training: settings and figures of its training. metrics: on the validation
    images of the base set: precision, recall, ap50, ap50_95, false_positives_an_image, all for visible pedestrians. calibration:
    slope and offset of the scores' logits, fitted on the same images.
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
    weights_sha256: str


def write_card(path: Path, card: ModelCard) -> None:
    """Write model.json."""
    write_json(path, card.model_dump(mode="json"))


def read_card(path: Path) -> ModelCard:
    """Read model.json; InputError that names the file and key if it is missing or no card."""
    try:
        return ModelCard.model_validate(read_json(path))
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"{path}: {'.'.join(map(str, first['loc'])) or 'the file'}: {first['msg']}; train the version again") from error
