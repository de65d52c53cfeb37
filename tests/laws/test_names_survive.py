"""Names of categories and conditions stay texts, even if they look like numbers or dates.

They do so from the space file to the table of the plan and back.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline.__main__ import main
from pipeline.artefacts.point_table import read_points, write_points
from pipeline.artefacts.space_file import read_space_file

LIKE_VALUES = (
    *(
        "1.1",
        "1.10",
        "01",
        "1",
        "1.0",
        "+1",
        "1e5",
        "100000",
        "inf",
        "-inf",
        "nan",
        "9007199254740992",
        "9007199254740993",
        "0x10",
        "1_000",
    ),
    *(
        "010",
        "12:30",
        "2024-01-01",
        "2024-01-01 00:00:00",
        "2024-01-01T00:00:00Z",
        "on",
        "off",
        "yes",
        "no",
        "true",
        "True",
        "TRUE",
        "null",
    ),
    *(
        "",
        " ",
        "a",
        " a",
        "a ",
        "~",
        "-",
        "=",
        "!=",
        "<<",
        "a, b",
        '"',
        '""',
        'x, "y"',
        ' "',
        "[0, 20)",
        "a\nb",
        "a\rb",
        "\ufeff",
        "\x00",
    ),
)
NAMES = st.lists(
    st.sampled_from(LIKE_VALUES) | st.text(st.characters(exclude_categories=["Cs"]), max_size=6),
    min_size=1,
    unique=True,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("names")


@given(NAMES, NAMES, st.sampled_from(["csv", "parquet"]))
@example(list(LIKE_VALUES), list(LIKE_VALUES), "csv")
@example(list(LIKE_VALUES), list(LIKE_VALUES), "parquet")
def test_any_distinct_texts_survive_the_round_trip(
    folder: Path, names: list[str], variables: list[str], kind: str
) -> None:
    space_file, table = folder / "space.yaml", folder / f"plan.{kind}"
    space_file.write_text(
        yaml.safe_dump(
            {"variables": {variable: {"values": list(names)} for variable in variables}},
            sort_keys=False,
        )
    )
    space = read_space_file(space_file)
    assert space.names == tuple(variables) and all(
        variable.values == tuple(names) for variable in space.variables
    )
    points = np.random.default_rng(len(names)).integers(0, len(names), (7, len(variables)))
    write_points(table, space, points)
    read = read_points(table, space)
    assert np.array_equal(read.strict(), points)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_unquoted_names_survive_planning_and_verification(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unquoted = (
        "1.1, 1.10, 01, 1, 1.0, 1e5, 100000, .inf, on, off, yes, no, 12:30, 010, "
        "2024-01-01, 2024-01-01 12:00:00, True, true, ="
    )
    names = unquoted.split(", ")
    space, plan = tmp_path / "space.yaml", tmp_path / f"plan.{kind}"
    space.write_text(
        f"variables: {{on: {{values: [{unquoted}]}}, "
        "t: {interval: [1700000000, 1700003600], cuts: [1700001200]}}"
    )
    assert read_space_file(space).variables[0].values == tuple(names)
    assert main(["coverage", "plan", "--space", str(space), "--output", str(plan)]) == 0
    for verb in ("verify", "score"):
        capsys.readouterr()
        assert main(["coverage", verb, "--space", str(space), "--points", str(plan), "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["valid"] if verb == "verify" else found["coverage"] == 1
