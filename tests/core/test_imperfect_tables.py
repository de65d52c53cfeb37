"""Imperfect tables of points: what counts, what is left out and listed, what is refused by name."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.__main__ import main
from pipeline.artefacts.table_categories import HINTED, Meanings
from pipeline.core.space import Variable

SPACE = """
variables:
  weather: {values: [sunny, rainy]}
  fog: {interval: [0, 100], cuts: [50]}
  lanes: {values: [1, 2]}
  current_lane: {values: [1, 2]}
constraints:
  - [lanes = 2, current_lane != 2]
"""
HEAD = "weather,fog,lanes,current_lane\n"

pytestmark = pytest.mark.usefixtures("short_annealing")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "space.yaml").write_text(SPACE)
    return tmp_path


def said(
    capsys: pytest.CaptureFixture[str],
    folder: Path,
    verb: str,
    points: str,
    *more: object,
    code: int = 0,
) -> Any:
    capsys.readouterr()
    words = [verb, "--space", folder / "space.yaml", "--points", folder / points, *more]
    assert main(["coverage", *map(str, words), "--json"]) == code
    out = capsys.readouterr()
    return json.loads(out.out) if code != 2 else out.err


def test_partial_rows_count_and_rows_that_break_a_constraint_do_not(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "sunny,3,1,1\nundefined,60,2,2\nrainy,,2,1\nundefined,500,1,1\nsunny,60,1,2\n?,?,1,2\n"
    (folder / "points.csv").write_text(HEAD + rows)
    result = said(capsys, folder, "score", "points.csv")
    assert (result["rows"], result["points"], result["partial"], result["left_out"]) == (6, 4, 3, 2)
    # Cells: weather-fog 1, weather-lanes 2, weather-current 2, fog-lanes 2, fog-current 2,
    # lanes-current 3.
    assert result["numerator"] == 12 and [row["numerator"] for row in result["by_k"]] == [8, 12]
    causes = [(cause["rows"], cause["left_out"], cause["cause"]) for cause in result["causes"]]
    assert causes[0] == (2, False, "row 2: weather must be one of sunny, rainy, got 'undefined'")
    assert (
        2,
        True,
        "row 5 breaks the constraint 'lanes = 2 or current_lane != 2': weather = sunny, fog = [50, "
        "100], lanes = 1, "
        "current_lane = 2",
    ) in causes
    assert (1, False, "row 3: fog must be a number in [0, 100], got nothing") in causes
    assert (
        2,
        False,
        "row 4: fog must be a number in [0, 100], got 500 and 1 other values",
    ) in causes
    proposed = said(capsys, folder, "propose", "points.csv", "--complete")
    assert (
        proposed["after"]["coverage"] == 1
        and proposed["before"]["numerator"] == 12
        and proposed["existing"]["partial"] == 3
    )


def test_strict_refuses_an_imperfect_row(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "points.csv").write_text(HEAD + "sunny,3,1,1\nundefined,60,2,2\n")
    for verb in ("score", "propose"):
        assert "points.csv: row 2: weather must be one of sunny, rainy, got 'undefined'" in said(
            capsys, folder, verb, "points.csv", "--strict", code=2
        )
    (folder / "points.csv").write_text(HEAD + "sunny,3,1,1\nsunny,60,1,2\n")
    assert "row 2 breaks the constraint" in said(
        capsys, folder, "score", "points.csv", "--strict", code=2
    )


def test_the_first_imperfect_row_is_named_whichever_its_column(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "points.csv").write_text(HEAD + "sunny,3,1,1\nsunny,3,7,1\nundefined,3,1,1\n")
    for words in (["score", "points.csv", "--strict"], ["verify", "points.csv"]):
        assert "points.csv: row 2: lanes must be one of 1, 2, got 7" in said(
            capsys, folder, *words, code=2
        )
    (folder / "points.csv").write_text(HEAD + "sunny,3,1,2\nundefined,3,1,1\n")
    assert "points.csv: row 1 breaks the constraint" in said(
        capsys, folder, "score", "points.csv", "--strict", code=2
    )


def test_the_text_lists_the_causes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "points.csv").write_text(HEAD + "sunny,3,1,1\nundefined,60,2,2\nundefined,60,1,2\n")
    assert (
        main(
            [
                "coverage",
                "score",
                "--space",
                str(folder / "space.yaml"),
                "--points",
                str(folder / "points.csv"),
            ]
        )
        == 0
    )
    text = capsys.readouterr().out
    counted = (
        "2 of 3 rows count; partial, so only for the conditions that they give: 1; left out, "
        "because they break a constraint: 1\n"
    )
    assert text.startswith(counted)
    assert "  2 × row 2: weather must be one of sunny, rainy, got 'undefined'\n" in text


def test_a_plan_with_a_broken_constraint_is_not_valid(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = folder / "plan.csv"
    assert (
        main(["coverage", "plan", "--space", str(folder / "space.yaml"), "--output", str(plan)])
        == 0
    )
    rows = len(plan.read_text().splitlines())
    plan.write_text(plan.read_text() + 'sunny,"[0, 50)",1,2\n')
    result = said(capsys, folder, "verify", "plan.csv", code=1)
    broken = (
        f"row {rows} breaks the constraint 'lanes = 2 or current_lane != 2': "
        "weather = sunny, fog = [0, 50), lanes = 1, current_lane = 2"
    )
    assert result["broken"] == [broken] and result["missing_cells"] == 0 and not result["valid"]
    assert (
        main(["coverage", "verify", "--space", str(folder / "space.yaml"), "--points", str(plan)])
        == 1
    )
    assert capsys.readouterr().out == f"not valid: {broken}\n"
    plan.write_text(plan.read_text() + "sunny,,1,1\n")
    assert f"row {rows + 1}: fog must be" in said(capsys, folder, "verify", "plan.csv", code=2)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (
            "p.csv",
            HEAD + "sunny,3,1,1\nsunny,3,1,1,7\n",
            "p.csv: row 2: Expected 4 columns, got 5: sunny,3,1,1,7",
        ),
        ("p.csv", HEAD + "sunny,3,1\n", "row 1: Expected 4 columns, got 3"),
        (
            "p.csv",
            "weather,fog,lanes,current_lane,fog\nsunny,3,1,1,60\n",
            "the column 'fog' appears twice",
        ),
        (
            "p.csv",
            HEAD.replace(",", ";") + "sunny;3;1;1\n",
            "expected commas between the columns, got semicolons",
        ),
        (
            "p.csv",
            HEAD.replace(",", "\t") + "sunny\t3\t1\t1\n",
            "expected commas between the columns, got tabs",
        ),
        ("p.csv", HEAD + 'sunny,3,"1,1\nsunny,3,1,1\n', "row 1 opens a quote and never closes it"),
        (
            "p.xlsx",
            "PK",
            "expected a CSV or parquet table, got .xlsx; what can be read: .csv, .txt, .parquet, "
            ".pq, JSON of COCO, BDD100K",
        ),
        ("p.jsonl", "{}", "expected a CSV or parquet table, got .jsonl"),
        (
            "p.parquet",
            HEAD,
            "p.parquet: expected a CSV or parquet table, got Parquet magic bytes not found",
        ),
        ("p.json", "[" * 100_000, "expected JSON"),
        (
            "p.csv",
            HEAD + "sunny,60,1,2\n",
            "every row breaks a constraint; row 1 breaks the constraint",
        ),
    ],
)
def test_a_table_that_cannot_be_read_as_it_is_meant_is_refused(
    name: str, text: str, message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / name).write_text(text)
    (folder / "meta.csv").write_text("file_name\n")
    assert message in said(
        capsys,
        folder,
        "score",
        name,
        *(["--metadata", folder / "meta.csv"] if "json" in name[-4:] else []),
        code=2,
    )


def test_a_csv_may_have_a_byte_order_mark_spaces_and_quotes(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (
        'weather, "fog" ,lanes , current_lane, note\r\nsunny, "[0, 50)", 1 ,1,"5"" long, '
        '""x"""\r\n\r\nrainy,"60",2.0,"2",a "b" c\r\n'
    )
    (folder / "points.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    result = said(capsys, folder, "score", "points.csv", "--strict")
    assert result["points"] == 2 and result["numerator"] == 12


def test_parquet_keeps_whole_numbers_times_and_missing_values_apart(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "space.yaml").write_text(
        "variables: "
        "{id: {values: [9007199254740992, 9007199254740993]}, t: {interval: [1700000000, "
        "1700003600], cuts: [1700001800]},\n"
        "  day: {values: [2023-11-14, 2023-11-15 06:00:00]}}"
    )
    table = {
        "id": pa.array([9007199254740992, 9007199254740993, None], pa.int64()),
        "t": pa.array(
            [datetime(2023, 11, 14, 22, 13, 20), datetime(2023, 11, 14, 23), None],
            pa.timestamp("ns"),
        ),
        "day": pa.array(
            [datetime(2023, 11, 14), datetime(2023, 11, 15, 6), datetime(2023, 11, 15)],
            pa.timestamp("us", "UTC"),
        ),
    }
    pq.write_table(pa.table(table), folder / "points.parquet")
    result = said(capsys, folder, "score", "points.parquet", "--k", 1)
    assert (result["numerator"], result["denominator"], result["partial"]) == (6, 6, 1)
    pd.DataFrame({"id": [1.5], "t": [True], "day": [None]}).to_parquet(folder / "points.parquet")
    assert said(capsys, folder, "score", "points.parquet", "--k", 1)["numerator"] == 0
    pq.write_table(
        pa.Table.from_arrays([pa.array([1])] * 4, ["id", "t", "day", "t"]),
        folder / "points.parquet",
    )
    assert "the column 't' appears twice" in said(capsys, folder, "score", "points.parquet", code=2)
    pq.write_table(pa.table({"id": [[1]], "t": [1], "day": [1]}), folder / "points.parquet")
    assert "id: expected texts, numbers, booleans or times" in said(
        capsys, folder, "score", "points.parquet", code=2
    )


def test_numbers_of_single_precision_and_times_mean_what_they_say_in_a_csv() -> None:
    share = Variable("x", "continuous", low=0, high=0.9, cuts=(0.7,))
    for kind in (pa.float32(), pa.float64()):
        written = pa.chunked_array([pa.array([0.5, 0.7, 0.9, None, float("nan")], kind)])
        assert list(Meanings(share).categories(written)) == [0, 1, 1, -1, -1], kind
    when = Variable("t", "continuous", low=1_700_000_000, high=1_700_003_600, cuts=(1_700_001_800,))
    texts = pa.chunked_array(
        [["2023-11-14T22:13:20", "2023-11-14 23:00:00Z", "2023-11-14", "soon"]]
    )
    assert list(Meanings(when).categories(texts)) == [0, 1, -1, -1]


def test_the_most_frequent_wrong_names_and_the_first_get_a_hint() -> None:
    weather = Meanings(Variable("weather", "categorical", values=("sunny", "rainy")))
    wrong = ["sunnny", *(f"sunny{i}" for i in range(40)), *(f"rainy{i}" for i in range(HINTED))]
    weather.categories(
        pa.chunked_array([[*wrong, *(text for text in wrong if text.startswith("rainy"))]])
    )
    hints = [fault.text for fault in weather.faults() if "did you mean" in fault.text]
    assert len(weather.faults()) == len(wrong) and len(hints) == 1 + HINTED
    assert "(did you mean 'sunny'?), got 'sunnny'" in hints[0] and all(
        "'rainy'" in text for text in hints[1:]
    )


def test_a_spelling_that_means_two_names_means_none() -> None:
    def of(names: tuple[str, ...], *texts: str) -> list[int]:
        return list(
            Meanings(Variable("x", "categorical", values=names)).categories(
                pa.chunked_array([list(texts)])
            )
        )

    assert of(("1", "1.0"), "1", "1.0", "1.00", " 1 ") == [0, 1, -1, 0]
    assert of(("01", "7"), "01", "1", "7.0", "7e0") == [0, 0, 1, 1]
    assert of(("true", "TRUE"), "true", "True") == [0, -1]
    assert of((" a", "b"), "a", " a", "b ") == [0, 0, 1]
    assert of(
        ("2024-01-01", "inf"),
        "2024-01-01T00:00",
        "2024-01-01 01:00+01:00",
        "2024-01-02",
        "Infinity",
    ) == [0, 0, -1, -1]
    assert of(("9007199254740992", "0.1"), "9007199254740993", "0.10", "1e-1") == [-1, 1, 1]
