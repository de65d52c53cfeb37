from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from pipeline.artefacts import files
from pipeline.artefacts import scenario_space as space
from pipeline.artefacts import tables as campaign
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame, KeptFrame
from pipeline.core.identity import CampaignId
from pipeline.core.matching import Criterion, Matching, match
from pipeline.core.space import Space, Variable
from pipeline.core.truth import Truth
from pipeline.errors import InputError

SPACE = Space(
    (
        Variable("fog", "continuous", "%", 0, 100, 10),
        Variable("animation", "categorical", values=("walking", "drunk")),
    )
)


def row(index: int = 0, **changed: Any) -> dict[str, Any]:
    values: dict[str, Any] = {
        column.name: {str: "x", int: 1, float: 0.5, bool: True}[column.kind]
        for column in campaign.TESTS
    }
    values |= {
        "test_id": f"F1-random-base-0-{index:05d}",
        "index": index,
        "status": "ok",
        "failure_mode": "late",
        "cause": "box",
    }
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
    campaign.write_frames(path, pd.DataFrame(columns=[column.name for column in campaign.FRAMES]))
    assert campaign.read_frames(path, ["test_id", "step"]).empty


@pytest.mark.parametrize(
    "changed", [{"status": "maybe"}, {"failure_mode": "unlucky"}, {"more": 1}, {"test_id": None}]
)
def test_wrong_rows_are_not_written(tmp_path: Path, changed: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(changed))):
        campaign.write_tests(
            tmp_path / "tests.parquet", pd.DataFrame([row(), row(**changed)]), SPACE
        )
    assert not (tmp_path / "tests.parquet").exists()


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"missing \['ttc_s'\]"):
        campaign.write_tests(
            tmp_path / "tests.parquet", pd.DataFrame([row()]).drop(columns="ttc_s"), SPACE
        )


@pytest.mark.parametrize("size", [0, 3, 200, -20])
def test_a_truncated_table_is_named(tmp_path: Path, size: int) -> None:
    path = tmp_path / "tests.parquet"
    campaign.write_tests(path, pd.DataFrame([row()]), SPACE)
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(InputError, match=r"tests\.parquet"):
        campaign.read_tests(path)


def test_another_table_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "timings.parquet"
    campaign.write_timings(
        path, pd.DataFrame([{"test_id": "a", "sampler_s": 0.1, "simulate_s": 0.2}])
    )
    with pytest.raises(InputError, match="expected a tests table"):
        campaign.read_tests(path)


def test_a_space_survives_a_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "F1.json"
    info = space.ScenarioInfo("F1star", "F1*", "A street.", 22, "0123abcd")
    space.write_space(path, info, SPACE)
    assert space.read_space(path) == (info, SPACE)


@pytest.mark.parametrize(
    "text", ["", '{"format": 1', "[]", '{"format": 9}', '{"format": 1, "scenario": "F1"}']
)
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
    page = (Path(__file__).parents[2] / "docs" / "reference" / "columns.md").read_text()
    for name, table in campaign.TABLES.items():
        section = page.partition(f"## {name}.parquet")[2].partition("\n## ")[0]
        rows = [line.split(" | ") for line in section.splitlines() if line.startswith("| `")]
        assert [(row[0], row[2], row[3]) for row in rows] == [
            (f"| `{c.name}`", c.unit, f"{c.meaning} |") for c in table
        ]


def test_a_table_of_several_campaigns_is_refused(tmp_path: Path) -> None:
    rows = pd.DataFrame([row(0), row(1)])
    assert campaign.campaign_of(rows, tmp_path) == CampaignId("x", "x", "x", 1)
    with pytest.raises(
        InputError,
        match=r"^tests\.parquet: expected the tests of one campaign, got 2 campaigns; "
        "make it again$",
    ):
        campaign.campaign_of(rows.assign(seed=[0, 1]), Path("tests.parquet"))


@pytest.mark.parametrize(
    "truth", [Truth(), Truth((1.0, 2.0, 3.0, 4.0), (0.0, 1.5, 3.0, 5.0), 7, 9, 12.5)]
)
def test_a_frames_truth_survives_a_round_trip(truth: Truth) -> None:
    kept = KeptFrame(3, Frame(np.zeros((8, 8, 3), np.uint8), truth), Detections.none(), Matching())
    row = campaign.frame_row(kept)
    assert {"test_id", "image", *row} == {column.name for column in campaign.FRAMES}
    assert campaign.frame_truth(pd.Series(row)) == truth


def test_the_confidence_of_a_kept_frame_is_that_of_a_detection_too_weak_to_be_reported() -> None:
    truth = Truth((10.0, 10.0, 20.0, 30.0), (10.0, 10.0, 20.0, 30.0), 200, 200, 50.0)
    found = Detections(np.array([truth.visible_box], np.float32), np.array([0.5], np.float32))
    kept = KeptFrame(
        0,
        Frame(np.zeros((8, 8, 3), np.uint8), truth),
        found,
        match(found, truth, Criterion(0.5, 0.8)),
    )
    assert kept.matching.confidence == 0 and campaign.frame_row(kept)["confidence"] == 0.5
