"""Exported spaces keep their constraints, named planes and single combinations, or say what they
leave out.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.artefacts.model_export import write_model
from pipeline.artefacts.space_file import read_space_file

SPACE = """variables:
  weather: {values: [dry, rainy], weights: {rainy: 2}}
  light: {values: [day, night]}
  lanes: {values: [1, 2, 3]}
constraints:
  - if weather = rainy then lanes in {1, 2}
  - [light = day, lanes != 3]
planes:
  sight: {conditions: [weather, light, lanes], strength: 3}
combinations:
  - {of: {weather: rainy, light: night}, weight: 3}
"""


def test_a_space_file_keeps_everything(tmp_path: Path) -> None:
    (tmp_path / "space.yaml").write_text(SPACE)
    space = read_space_file(tmp_path / "space.yaml")
    assert write_model(tmp_path / "again.yaml", space, "space") == []
    again = read_space_file(tmp_path / "again.yaml")
    assert (again.variables, again.clauses, again.extras) == (
        space.variables,
        space.clauses,
        space.extras,
    )


@pytest.mark.parametrize(
    ("kind", "suffix"), [("space", "yaml"), ("pict", "txt"), ("acts-xml", "xml")]
)
def test_no_model_has_the_rules_of_sequences(kind: str, suffix: str, tmp_path: Path) -> None:
    rule = "wet: {first: rain >= 50, then: rain < 50, within: 2}"
    frames = "rain: {interval: [0, 100], cuts: [50]}"
    (tmp_path / "s.yaml").write_text(
        f"sequences: {{time: t}}\nframes: {{{frames}}}\nvariables: {{{rule}}}\n"
    )
    assert "the frames and the rules of wet" in write_model(
        tmp_path / f"out.{suffix}", read_space_file(tmp_path / "s.yaml"), kind
    )


@pytest.mark.parametrize(("kind", "suffix"), [("pict", "txt"), ("acts-xml", "xml")])
def test_models_of_other_tools_lack_planes(kind: str, suffix: str, tmp_path: Path) -> None:
    (tmp_path / "space.yaml").write_text(SPACE)
    left_out = write_model(
        tmp_path / f"model.{suffix}", read_space_file(tmp_path / "space.yaml"), kind
    )
    assert left_out[-2:] == ["the named planes sight", "the single combinations"]
