"""The filter of campaign frames and a person's overruling."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.analysis.frame_criteria import CRITERIA, KEPT, MEANINGS, Criterion
from pipeline.artefacts.dataset import encode_jpeg
from pipeline.artefacts.filter_table import read_filter, read_overrules
from pipeline.config.sections import Filter
from pipeline.core.signals import SIDES
from pipeline.errors import InputError
from pipeline.learning import frame_filter
from pipeline.learning.frame_filter import judge
from tests.analysis.fabricated import FabricatedStudy

SECTION = Filter(min_visible_pixels=20, min_detectability=60, overrules=None)
IMAGE = encode_jpeg(np.zeros((48, 80, 3), np.uint8))
FRAMES = pd.DataFrame(
    {
        "test_id": [f"F-random-base-0-{i:05d}" for i in range(7)],
        "step": range(7),
        "image": [IMAGE] * 7,
        "visible_pixels": [0, 0, 19, 25, 25, 90, 900],
        "whole_pixels": [0, 500, 19, 25, 25, 901, 900],
        "contrast": [0.0, 0.0, 50.0, 11.9, 12.0, 50.0, 2.0],
        "confidence": 0.0,
        **{f"visible_{side}": 0.0 for side in SIDES},
    }
)


def test_reasons_at_their_limits() -> None:
    judged = judge(FRAMES, SECTION)
    assert judged["reason"].tolist() == [
        "negative",
        "negative",
        "few_pixels",
        "low_contrast",
        "visible",
        "barely_in_view",
        "visible",
    ]
    assert judged["kept"].tolist() == [True, True, False, False, True, False, True]


def test_the_first_criterion_gives_the_reason() -> None:
    # First frame: few pixels, barely in view and faint; second frame: barely in view and faint.
    frames = FRAMES.head(2).assign(visible_pixels=[10, 30], whole_pixels=1000, contrast=1.0)
    assert judge(frames, SECTION)["reason"].tolist() == ["few_pixels", "barely_in_view"]


def test_every_reason_has_a_meaning() -> None:
    assert set(judge(FRAMES, SECTION)["reason"]) <= set(MEANINGS)
    assert len(MEANINGS) == len(KEPT) + len(CRITERIA) and len(set(MEANINGS.values())) == len(
        MEANINGS
    )


def test_a_new_criterion_judges_by_its_declaration_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    unsure = Criterion(
        "unsure",
        "the detector hardly sees it",
        lambda frames, kept, _: kept & (frames["confidence"] < 0.1).to_numpy(),
    )
    monkeypatch.setattr(frame_filter, "CRITERIA", (unsure, *CRITERIA))
    assert set(judge(FRAMES, SECTION)["reason"]) == {"unsure"}


def run(study: FabricatedStudy, overrules: Path) -> pd.DataFrame:
    section = study.config.filter.model_copy(update={"overrules": str(overrules)})
    study.config = study.config.model_copy(update={"filter": section})
    study.run("filter", kind="filter", strategy="random", version="base")
    return read_filter(study.folder / study.files.filter("random")).set_index(["test_id", "step"])


def test_a_person_overrules(tmp_path: Path) -> None:
    study, path = FabricatedStudy(tmp_path).make(), tmp_path / "overrules.csv"
    path.write_text(
        "test_id,step,keep\n"
        "F1-random-base-0-00001,1,true\n"
        "F1-random-base-0-00001,4,no\n"
        "F1-mixed-base-0-00001,1,true\n"
    )
    table = run(study, path)
    assert len(table) == 4 * 6 * 5
    assert table.loc[("F1-random-base-0-00001", 1)][["kept", "reason"]].tolist() == [
        True,
        "overruled (was few_pixels)",
    ]
    assert table.loc[("F1-random-base-0-00001", 4)][["kept", "reason"]].tolist() == [
        False,
        "overruled (was visible)",
    ]
    assert table.loc[("F1-random-base-0-00002", 4), "kept"]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (
            "F1-random-base-0-99999,1,true",
            "line 2: expected a kept frame of this study, got frame 1 of test "
            "'F1-random-base-0-99999'",
        ),
        ("F1-randon-base-0-00001,1,true", "line 2: expected a kept frame"),
        ("F1-random-adaptive-r9-s7-0-00001,1,true", "line 2: expected a kept frame"),
        ("F1-random-control-0-00001,1,true", "line 2: expected a kept frame"),
        ("F1star-mixed-base-0-00001,1,true", "line 2: expected a kept frame"),
        ("F1-mixed-base-7-00001,1,true", "line 2: expected a kept frame"),
        ("F1-mixed-base-0-00060,1,true", "line 2: expected a kept frame"),
        ("F1-random-base-0-00001,1,maybe", "line 2: keep must be true or false, got 'maybe'"),
        ("F1-random-base-0-00001,1.5,true", "line 2: step must be a whole number"),
        ("F1-random-base-0-00001,²,true", "line 2: step must be a whole number"),
        (f"F1-random-base-0-00001,{10**20},true", "line 2: step must be a whole number"),
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


def test_repeated_views_of_an_episode_are_kept_once() -> None:
    rng = np.random.default_rng(0)
    views = [
        rng.integers(0, 255, (24, 40, 3), dtype=np.uint8).repeat(8, 0).repeat(8, 1)
        for _ in range(2)
    ]
    boxes = [
        (10.0, 10.0, 30.0, 60.0),
        (11.0, 10.0, 31.0, 60.0),
        (60.0, 10.0, 80.0, 60.0),
        (np.nan,) * 4,
    ]
    # Episode a: the same frame twice, the pedestrian elsewhere, nobody, another view twice. Episode
    # b: the first view again.
    rows = [
        ("a", 0, 0),
        ("a", 0, 1),
        ("a", 0, 2),
        ("a", 0, 3),
        ("a", 1, 3),
        ("a", 1, 3),
        ("b", 0, 0),
    ]
    frames = pd.DataFrame(
        {
            "test_id": [test for test, _, _ in rows],
            "image": [encode_jpeg(views[view]) for _, view, _ in rows],
        }
    )
    frames = frames.assign(
        step=range(7), visible_pixels=500, whole_pixels=500, contrast=50.0, confidence=0.0
    )
    for position, side in enumerate(SIDES):
        frames[f"visible_{side}"] = [boxes[box][position] for _, _, box in rows]
    assert judge(frames, SECTION)["kept"].tolist() == [True, False, True, True, True, False, True]
    # A frame rejected for another reason is not compared with.
    judged = judge(frames.assign(visible_pixels=[5, *[500] * 6]), SECTION)
    assert judged["reason"].tolist() == [
        "few_pixels",
        "visible",
        "visible",
        "visible",
        "visible",
        "near_duplicate",
        "visible",
    ]
    # Empty frames are also kept once.
    assert judge(frames.assign(visible_pixels=0), SECTION)["reason"].tolist()[:3] == [
        "negative",
        "near_duplicate",
        "negative",
    ]


def test_a_frame_exactly_at_a_limit_is_kept() -> None:
    frames = FRAMES.head(2).assign(visible_pixels=20, whole_pixels=[20, 200], contrast=50.0)
    assert judge(frames, SECTION)["kept"].tolist() == [True, True]


def test_a_pedestrian_who_has_moved_half_a_box_or_drifts_away_is_seen_anew() -> None:
    frames = pd.DataFrame(
        {
            "test_id": "a",
            "image": [IMAGE] * 5,
            "step": range(5),
            "visible_pixels": 500,
            "whole_pixels": 500,
        }
    )
    frames = frames.assign(contrast=50.0, confidence=0.0, visible_top=10.0, visible_bottom=60.0)
    # Boxes 20 wide: 10 apart is an IoU of a third; then 1 to the right from frame to frame, and 3
    # are an IoU of 17 / 23.
    left = np.array([10.0, 20, 21, 22, 23])
    assert judge(frames.assign(visible_left=left, visible_right=left + 20), SECTION)[
        "kept"
    ].tolist() == [True, True, False, False, True]


def test_equal_frames_of_two_tests_are_both_kept() -> None:
    frames = FRAMES.iloc[[4, 4]].assign(visible_right=20.0, visible_bottom=20.0)
    assert [
        judge(frames.assign(test_id=names), SECTION)["kept"].tolist() for names in (["a", "b"], "a")
    ] == [[True, True], [True, False]]
