from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.artefacts.model_card import read_card, write_card
from pipeline.errors import InputError
from tests.cards import CARD


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
