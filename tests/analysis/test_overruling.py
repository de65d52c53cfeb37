"""A person's table overrules the filter: rows for each filter table, and wrong rows."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from pipeline.config.composing import compose
from pipeline.errors import InputError
from pipeline.learning.frame_filter import judged_elsewhere, overrule

CONFIG = compose("default", ["seeds=[0,1]", "campaign.tests=60", "retraining.rounds=2"])
JUDGED = pd.DataFrame(
    {
        "test_id": "F1-random-base-0-00001",
        "step": [0, 5],
        "kept": [True, False],
        "reason": ["visible", "few_pixels"],
    }
)
ELSEWHERE = judged_elsewhere(CONFIG, "random", "base")


def overruled(*rows: tuple[str, int, bool]) -> pd.DataFrame:
    return overrule(
        JUDGED, pd.DataFrame(rows, columns=["test_id", "step", "keep"]), ELSEWHERE, Path("o.csv")
    )


def test_rows_for_other_tables_are_ignored() -> None:
    others = [
        ("F1-mixed-base-1-00059", 3, True),
        ("F1-mixed-adaptive-0-00000", 0, False),
        ("F1-random-random-1-00007", 0, True),
    ]
    table = overruled(
        ("F1-random-base-0-00001", 0, False), *others, ("F1-random-base-0-00001", 5, True)
    )
    assert table["kept"].tolist() == [False, True]
    assert table["reason"].tolist() == ["overruled (was visible)", "overruled (was few_pixels)"]


@pytest.mark.parametrize(
    "test_id",
    [
        "F1-random-base-0-00002",  # No frame of this test was kept.
        "F1star-mixed-base-0-00001",  # Held out.
        "F9-mixed-base-0-00001",
        "F1-neurol-base-0-00001",
        "F1-mixed-adaptive-r2-0-00001",  # The last round's version has no search.
        "F1-mixed-base-2-00001",
        "F1-mixed-base-0-00060",
        "F1-mixed-base-0-1",
        "F1-mixed",
    ],
)
def test_a_row_about_an_unknown_test_is_refused(test_id: str) -> None:
    with pytest.raises(InputError) as caught:
        overruled(("F1-random-base-0-00001", 0, False), (test_id, 3, True))
    assert (
        str(caught.value)
        == f"o.csv, line 3: expected a kept frame of this study, got frame 3 of test '{test_id}'"
    )
