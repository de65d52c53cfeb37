"""Tables read in batches of any size are reported as tables read at once.

Points that raise coverage stand for all.
"""

from __future__ import annotations

import io
import json
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.__main__ import main
from pipeline.analysis.data_coverage import counted, growth
from pipeline.artefacts import csv_batches, table_categories, table_file
from pipeline.core.constraints import Constraints
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.coverage.proposals import Proposer

SPACE = """variables:
  sky: {values: [on, off, 1.10], weights: {off: 2}}
  fog: {interval: [0, 100], cuts: [20, 50]}
  lanes: {values: [1, 2]}
constraints:
  - [lanes = 2, sky != off]
"""
FIELDS = (
    ("on", "off", "1.10", '"on"', ' "off"', "?", "", "1.1"),
    ("3", "20", "70", '"[0, 20)"', "200", '"5"', ""),
    ("1", "2", "2.0", '"a\nb"', ""),
)
ROWS = st.lists(st.tuples(*(st.sampled_from(fields) for fields in FIELDS)), min_size=1, max_size=40)
ENDS = st.sampled_from(["\n", "\r\n", "\r", "\n\n"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("streamed")
    (path / "space.yaml").write_text(SPACE)
    return path


def said(folder: Path, points: str, verb: str, *more: str) -> tuple[int, str, str]:
    with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as error:
        code = main(
            [
                "coverage",
                verb,
                "--space",
                str(folder / "space.yaml"),
                "--points",
                str(folder / points),
                "--json",
                *more,
            ]
        )
    return code, out.getvalue(), error.getvalue().splitlines()[-1] if code else ""


def compared(folder: Path, points: str, block: int) -> None:
    """The same answers with blocks of a few bytes or rows as with the whole table."""
    for words in (
        ("score",),
        ("score", "--strict"),
        ("propose", "--count", "2"),
        ("propose", "--complete", "--k", "1"),
    ):
        whole = said(folder, points, *words)
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(csv_batches, "BLOCK", block)
            patched.setattr(table_file, "BATCH_ROWS", block)
            assert said(folder, points, *words) == whole


@settings(max_examples=25)
@given(rows=ROWS, end=ENDS, block=st.integers(64, 200), last=st.booleans())
def test_a_csv_in_blocks_is_the_whole_csv(
    folder: Path, rows: list[tuple[str, ...]], end: str, block: int, last: bool
) -> None:
    text = end.join(["sky,fog,lanes,note", *(",".join((*row, "x")) for row in rows)]) + (
        end if last else ""
    )
    (folder / "points.csv").write_bytes(text.encode())
    compared(folder, "points.csv", block)


@settings(max_examples=15)
@given(rows=ROWS, block=st.integers(1, 9), groups=st.integers(1, 50))
def test_a_parquet_table_in_batches_is_the_whole_table(
    folder: Path, rows: list[tuple[str, ...]], block: int, groups: int
) -> None:
    columns: dict[str, Any] = {
        name: [row[i] or None for row in rows] for i, name in enumerate(("sky", "fog", "lanes"))
    }
    columns["fog"] = pa.array(
        [float(text) if text and text.isdecimal() else None for text in columns["fog"]]
    )
    pq.write_table(pa.table(columns), folder / "points.parquet", row_group_size=groups)
    compared(folder, "points.parquet", block)


@pytest.mark.parametrize("block", [64, 80, 1 << 20])
def test_wrong_rows_are_named_in_any_block(
    folder: Path, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_batches, "BLOCK", block)
    head = "sky,fog,lanes\n"
    for rows, message in (
        ("on,3,1\n" * 9 + "on,3\n", "row 10: Expected 3 columns, got 2: on,3"),
        ("on,3,1\n" * 9 + 'on,"3,1\non,3,1\n', "row 10 opens a quote and never closes it"),
        ("on,3,1\n" * 9 + 'on,3,"1\non,3,1\n', "row 10 opens a quote and never closes it"),
        ("on,3,1\n" * 9 + "off,3,1\n" + "off,3,1\n", "row 10 breaks the constraint"),
        ("on,3,1\n" * 9 + "on,\xff,1\n", "row 10: CSV conversion error to string: invalid UTF8"),
    ):
        (folder / "wrong.csv").write_bytes((head + rows).encode("latin-1"))
        code, _, error = said(folder, "wrong.csv", "score", "--strict")
        assert code == 2 and message in error


def test_values_keep_their_spelling(folder: Path) -> None:
    text = 'a, "b" ,c\n01, "1e5",\n1.0, "x, y" ,""\n"p, ""q""", "x, ""y""",z\n'
    (folder / "names.csv").write_text(text)
    table = table_file.read_table(folder / "names.csv", ["a", "b", "c"])
    assert table.columns["a"].to_pylist() == ["01", "1.0", 'p, "q"']
    assert table.columns["b"].to_pylist() == ["1e5", "x, y ", 'x, "y"']
    assert table.columns["c"].to_pylist() == [None, "", "z"]


def test_a_header_that_is_not_text_is_rejected(folder: Path) -> None:
    (folder / "header.csv").write_bytes(b"sky,fog,lanes,\xff\non,3,1,1\n")
    assert "header.csv: the header is not UTF-8 text" in said(folder, "header.csv", "score")[2]


def test_a_row_without_end_is_rejected(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_batches, "BLOCK", 64)
    (folder / "long.csv").write_text('sky,fog,lanes\non,"3,1\n' + "on,3,1\n" * 1000)
    assert (
        "row 1 is longer than 0 MB; perhaps it opens a quote and never closes it"
        in said(folder, "long.csv", "score")[2]
    )


def test_many_different_values_are_kept_up_to_a_limit(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_categories, "MOST_DIFFERENT", 50)
    monkeypatch.setattr(csv_batches, "BLOCK", 256)
    (folder / "many.csv").write_text(
        "sky,fog,lanes\n" + "".join(f"on,{1000 + i},1\n" for i in range(200))
    )
    (cause,) = json.loads(said(folder, "many.csv", "score")[1])["causes"]
    assert cause["rows"] == 200 and "got 1000 and at least 49 other values" in cause["cause"]


@settings(max_examples=40)
@given(st.data())
def test_raising_points_stand_for_all_points(data: st.DataObject) -> None:
    sizes = tuple(data.draw(st.lists(st.integers(1, 4), min_size=2, max_size=4)))
    k = data.draw(st.integers(1, len(sizes)))
    weights = [
        data.draw(st.lists(st.integers(0, 3), min_size=size, max_size=size).filter(any))
        for size in sizes
    ]
    demand, rng = (
        Demand(Constraints(sizes), k, weights),
        np.random.default_rng(data.draw(st.integers(0, 99))),
    )
    points = rng.integers(-1, sizes, (data.draw(st.integers(1, 60)), len(sizes)))
    batches = np.array_split(points, data.draw(st.integers(1, 5)))
    _, raising = counted(batches, [demand], lambda _: None)
    proposer = Proposer(demand)
    assert np.array_equal(proposer.missing(raising.points), proposer.missing(points))
    assert len(raising.points) <= proposer.missing(points[:0]).sum()
    coverage = projection_coverage(points, demand)
    for end, ratio in growth(raising, coverage):
        assert ratio == projection_coverage(points[:end], demand).ratio
