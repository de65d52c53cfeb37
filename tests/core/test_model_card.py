from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.artefacts.model_card import ModelCard, read_card, write_card
from pipeline.errors import InputError

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


def test_a_card_is_read_as_it_was_written(tmp_path: Path) -> None:
    write_card(tmp_path / "model.json", CARD)
    assert read_card(tmp_path / "model.json") == CARD


@pytest.mark.parametrize("text", ["{}", "[]", "{", '{"version": 3}'])
def test_other_files_are_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "model.json").write_text(text)
    with pytest.raises(InputError, match=r"model\.json"):
        read_card(tmp_path / "model.json")


def test_an_unknown_key_is_told_with_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    write_card(path, CARD)
    path.write_text(path.read_text().replace('"towns"', '"town"'))
    with pytest.raises(
        InputError,
        match=r"model\.json: unknown key 'town'; did you mean 'towns'\?; train the version again",
    ):
        read_card(path)
