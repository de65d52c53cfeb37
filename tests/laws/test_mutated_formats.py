"""The how-to's files of foreign formats.

They mean what a person reads in them; damaged, they are refused by name or still make a space.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings

from pipeline.artefacts.point_table import read_points
from pipeline.artefacts.space_formats import read_space_of_any_format
from pipeline.errors import InputError
from tests.laws.mutations import CHANGES, mutated

EXAMPLES = Path(__file__).parents[2] / "docs/howto/standard-odds"
SPACES = ("odd.yaml", "iso34503.yaml", "pict.txt", "acts.txt", "acts.xml")
SETS = {
    "openlabel/crossing.json": ("openlabel.yaml", "openlabel"),
    "openlabel/drive.json": ("openlabel.yaml", "openlabel/drive.json"),
    "bdd100k.json": ("bdd100k.yaml", "bdd100k.json"),
    "kitti/label_2/000000.txt": ("kitti.yaml", "kitti"),
    "nuscenes/scene.json": ("nuscenes.yaml", "nuscenes"),
    "nuscenes/sample.json": ("nuscenes.yaml", "nuscenes"),
}
"""The file that is damaged, its space, and its data set."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(EXAMPLES, tmp_path_factory.mktemp("formats") / "examples"))


@pytest.mark.parametrize(
    ("space", "points", "expected"),
    [
        ("openlabel.yaml", "openlabel", [[2, 1, 1], [0, 0, 2], [0, 2, 2]]),
        ("bdd100k.yaml", "bdd100k.json", [[3, 0, 2, 1], [-1, 1, 0, 0], [0, 0, 1, 1]]),
        ("kitti.yaml", "kitti", [[0, 2, 1], [1, 3, 0], [2, -1, 1]]),
        ("nuscenes.yaml", "nuscenes", [[1, 1, 1, 0, 0], [1, 1, 1, 0, 1], [0, 0, 0, 1, 0]]),
    ],
)
def test_the_examples_mean_what_they_say(
    space: str, points: str, expected: list[list[int]]
) -> None:
    metadata = EXAMPLES / "kitti.csv" if points == "kitti" else None
    table = read_points(
        EXAMPLES / points, read_space_of_any_format(EXAMPLES / space), metadata=metadata
    )
    assert [
        row for batch in table.counting() for row in batch.tolist()
    ] == expected and table.points == table.rows


@pytest.mark.parametrize(("name", "rows"), [("pict.txt", 84), ("acts.txt", 30), ("acts.xml", 5)])
def test_the_models_allow_as_many_rows_as_counted_by_hand(name: str, rows: int) -> None:
    # Six pairs of lanes, three of them below 3. By light: day 2 × 3 × 6, dusk 2 × 6 + 3 × 2 × 3,
    # night 6 + 2 × 2 × 3.
    space = read_space_of_any_format(EXAMPLES / name)
    assert int(space.constraints.feasible_cells(range(len(space))).sum()) == rows


@pytest.mark.parametrize("name", SPACES)
@settings(max_examples=80)
@given(changes=CHANGES)
def test_damaged_spaces_are_refused_by_name_or_read(
    folder: Path, name: str, changes: list[tuple[int, int, str]]
) -> None:
    assert_named_or_read(
        folder, name, changes, lambda: len(read_space_of_any_format(folder / name)) > 0
    )


@pytest.mark.parametrize("name", SETS)
@settings(max_examples=80)
@given(changes=CHANGES)
def test_damaged_sets_are_refused_by_name_or_counted(
    folder: Path, name: str, changes: list[tuple[int, int, str]]
) -> None:
    space, points = SETS[name]
    metadata = folder / "kitti.csv" if points == "kitti" else None

    def counted() -> bool:
        table = read_points(
            folder / points, read_space_of_any_format(folder / space), metadata=metadata
        )
        list(table.counting())
        return len(table.images) == table.rows > 0

    assert_named_or_read(folder, name, changes, counted)


def assert_named_or_read(
    folder: Path, name: str, changes: list[tuple[int, int, str]], read: Callable[[], bool]
) -> None:
    """Damage a file, read it, and put it back."""
    original = (EXAMPLES / name).read_text()
    (folder / name).write_bytes(mutated(original, changes).encode())
    message = ""
    try:
        assert read()
    except InputError as error:
        message = str(error)
    (folder / name).write_text(original)
    assert not message or str(folder) in message
