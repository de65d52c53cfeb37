from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import pytest

from pipeline.artefacts import files
from pipeline.artefacts import scenario_space as space
from pipeline.artefacts import tables as campaign
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError

SPACE = Space((Variable("fog", "continuous", "%", 0, 100, 10), Variable("animation", "categorical", values=("walking", "drunk"))))


def row(index: int = 0, **changed: Any) -> dict[str, Any]:
    values: dict[str, Any] = {name: {str: "x", int: 1, float: 0.5, bool: True}[kind] for name, kind, _ in campaign.TESTS}
    values |= {"test_id": f"F1-random-base-0-{index:05d}", "index": index, "status": "ok", "failure_mode": "late"}
    return values | {"fog": 12.5, "animation": "drunk"} | changed


def test_tests_survive_a_round_trip_with_their_units(tmp_path: Path) -> None:
    path = tmp_path / "tests.parquet"
    table = pd.DataFrame([row(0), row(1, status="error", reason="broke", adj_ttc_s=float("nan"))])
    campaign.write_tests(path, table, SPACE)
    pd.testing.assert_frame_equal(campaign.read_tests(path), table, check_dtype=False)
    assert campaign.read_tests(path, ["fog", "failure"]).columns.tolist() == ["fog", "failure"]
    assert pq.read_schema(path).field("fog").metadata == {b"unit": b"%"}
    assert pq.read_schema(path).field("impact_speed_mps").metadata == {b"unit": b"m/s"}


def test_the_same_rows_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        campaign.write_tests(tmp_path / name, pd.DataFrame([row(0), row(1)]), SPACE)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_tables_without_rows_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "frames.parquet"
    campaign.write_frames(path, pd.DataFrame(columns=[name for name, _, _ in campaign.FRAMES]))
    assert campaign.read_frames(path, ["test_id", "step"]).empty


@pytest.mark.parametrize("changed", [{"status": "maybe"}, {"failure_mode": "unlucky"}, {"more": 1}, {"test_id": None}])
def test_wrong_rows_are_not_written(tmp_path: Path, changed: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(changed))):
        campaign.write_tests(tmp_path / "tests.parquet", pd.DataFrame([row(), row(**changed)]), SPACE)
    assert not (tmp_path / "tests.parquet").exists()


def test_a_column_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"missing \['ttc_s'\]"):
        campaign.write_tests(tmp_path / "tests.parquet", pd.DataFrame([row()]).drop(columns="ttc_s"), SPACE)


@pytest.mark.parametrize("size", [0, 3, 200, -20])
def test_a_truncated_table_is_named(tmp_path: Path, size: int) -> None:
    path = tmp_path / "tests.parquet"
    campaign.write_tests(path, pd.DataFrame([row()]), SPACE)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(InputError, match=r"tests\.parquet"):
        campaign.read_tests(path)


def test_another_table_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "timings.parquet"
    campaign.write_timings(path, pd.DataFrame([{"test_id": "a", "sampler_s": 0.1, "simulate_s": 0.2}]))
    with pytest.raises(InputError, match="expected a tests table"):
        campaign.read_tests(path)


def test_a_space_survives_a_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "F1.json"
    info = space.ScenarioInfo("F1star", "F1*", "A street.", 22, "0123abcd")
    space.write_space(path, info, SPACE)
    assert space.read_space(path) == (info, SPACE)


@pytest.mark.parametrize("text", ["", '{"format": 1', "[]", '{"format": 9}', '{"format": 1, "scenario": "F1"}'])
def test_a_damaged_space_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "F1.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"F1\.json"):
        space.read_space(path)


def test_a_failed_write_leaves_the_old_file_alone(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    files.write_json(path, {"old": 1})
    with pytest.raises(ValueError, match="JSON"):
        files.write_json(path, {"new": float("nan")})
    assert files.read_json(path) == {"old": 1}
    assert list(tmp_path.iterdir()) == [path]


def test_every_column_is_explained() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "system-under-test.md").read_text()
    tables = (campaign.TESTS, campaign.SIGNAL_TABLE, campaign.FRAMES, campaign.TIMINGS)
    assert [name for table in tables for name, _, _ in table if f"`{name}`" not in page] == []
