"""The filter of campaign frames and its overruling."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artefacts.dataset import encode_jpeg
from pipeline.artefacts.filter_table import read_filter, read_overrules
from pipeline.errors import InputError
from pipeline.steps import filter
from tests.analysis.fabricated import FabricatedStudy, silent

FRAMES = pd.DataFrame(
    {
        "test_id": "F-random-base-0-00000",
        "step": range(7),
        "visible_pixels": [0, 0, 19, 25, 25, 90, 900],
        "whole_pixels": [0, 500, 19, 25, 25, 901, 900],
        "contrast": [0.0, 0.0, 50.0, 11.9, 12.0, 50.0, 2.0],
        "confidence": 0.0,
    }
)


def test_reasons_at_their_limits() -> None:
    judged = filter.judge(FRAMES, min_visible_pixels=20, min_detectability=60)
    assert judged["reason"].tolist() == ["negative", "negative", "few_pixels", "low_contrast", "visible", "barely_in_view", "visible"]
    assert judged["kept"].tolist() == [True, True, False, False, True, False, True]


def run(study: FabricatedStudy, overrules: Path) -> pd.DataFrame:
    section = study.config.filter.model_copy(update={"overrules": str(overrules)})
    out = study.root / "filter.csv"
    config = study.config.model_copy(update={"filter": section})
    filter.run(config, frames=study.frames("random"), out=out, progress=silent)
    return read_filter(out).set_index(["test_id", "step"])


def test_a_person_overrules(tmp_path: Path) -> None:
    study, path = FabricatedStudy(tmp_path).make(), tmp_path / "overrules.csv"
    path.write_text("test_id,step,keep\nF1-random-base-0-00001,1,true\nF1-random-base-0-00001,4,no\nF1-neural-base-0-00001,1,true\n")
    table = run(study, path)
    assert len(table) == 4 * 6 * 5
    assert table.loc[("F1-random-base-0-00001", 1)][["kept", "reason"]].tolist() == [True, "overruled (was few_pixels)"]
    assert table.loc[("F1-random-base-0-00001", 4)][["kept", "reason"]].tolist() == [False, "overruled (was visible)"]
    assert table.loc[("F1-random-base-0-00002", 4), "kept"]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("F1-random-base-0-99999,1,true", "line 2: expected a kept frame of this study, got frame 1 of test 'F1-random-base-0-99999'"),
        ("F1-randon-base-0-00001,1,true", "line 2: expected a kept frame"),
        ("F1-random-adaptive-r9-s7-0-00001,1,true", "line 2: expected a kept frame"),
        ("F1-random-control-0-00001,1,true", "line 2: expected a kept frame"),
        ("F1-random-base-0-00001,1,maybe", "line 2: keep must be true or false, got 'maybe'"),
        ("F1-random-base-0-00001,1.5,true", "line 2: step must be a whole number"),
        (",1,true", "line 2: test_id is missing"),
        ("F1-random-base-0-00001,x,true", "line 2: step must be a whole number, got 'x'"),
        (
            "F1-random-base-0-00001,1,true\nF1-random-base-0-00001,1,true",
            "line 3: frame 1 of test F1-random-base-0-00001 is overruled twice",
        ),
    ],
)
def test_wrong_rows_are_named(tmp_path: Path, row: str, message: str) -> None:
    study, path = FabricatedStudy(tmp_path).make(), tmp_path / "overrules.csv"
    path.write_text(f"test_id,step,keep\n{row}\n")
    with pytest.raises(InputError) as caught:
        run(study, path)
    assert message in str(caught.value)
    assert "overrules.csv" in str(caught.value)


def test_wrong_columns_and_missing_file_are_named(tmp_path: Path) -> None:
    path = tmp_path / "o.csv"
    with pytest.raises(InputError, match=r"o\.csv"):
        read_overrules(path)
    path.write_text("test,step,keep\n")
    with pytest.raises(InputError, match="columns must be test_id,step,keep, got test,step,keep"):
        read_overrules(path)


def test_what_an_episode_shows_twice_is_kept_once() -> None:
    rng = np.random.default_rng(0)
    views = [rng.integers(0, 255, (24, 40, 3), dtype=np.uint8).repeat(8, 0).repeat(8, 1) for _ in range(2)]
    boxes = [(10.0, 10.0, 30.0, 60.0), (11.0, 10.0, 31.0, 60.0), (60.0, 10.0, 80.0, 60.0), (np.nan,) * 4]
    # Episode a: the same twice, another place of the pedestrian, nobody; twice another view. Episode b: the first view again.
    rows = [("a", 0, 0), ("a", 0, 1), ("a", 0, 2), ("a", 0, 3), ("a", 1, 3), ("a", 1, 3), ("b", 0, 0)]
    frames = pd.DataFrame({"test_id": [test for test, _, _ in rows], "image": [encode_jpeg(views[view]) for _, view, _ in rows]})
    for position, side in enumerate(("left", "top", "right", "bottom")):
        frames[f"visible_{side}"] = [boxes[box][position] for _, _, box in rows]
    assert filter.near_duplicates(frames, np.ones(7, bool)).tolist() == [False, True, False, False, False, True, False]
    # What was rejected for another reason is nothing to compare with.
    assert filter.near_duplicates(frames, np.array([False, *[True] * 6])).tolist() == [False, False, False, False, False, True, False]
    judged = pd.DataFrame({"kept": [True, True, False], "reason": ["visible", "visible", "few_pixels"]})
    assert filter.thin(judged, np.array([False, True, False]))["reason"].tolist() == ["visible", "near_duplicate", "few_pixels"]
