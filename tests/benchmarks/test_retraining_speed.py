"""The speed of retraining: ratios by hand."""

from __future__ import annotations

import pandas as pd
import retraining_speed


def test_the_ratio_is_that_of_each_round() -> None:
    speeds = [(0, 200, 100), (1, 150, 100), (2, 190, 50)]
    rows = [
        {"round": number, "code": code, "images_per_s": speed}
        for number, *both in speeds
        for code, speed in zip(("today", "0.2"), both, strict=True)
    ]
    said = retraining_speed.answer(pd.DataFrame(rows).assign(processor="a processor")).replace(
        "\n", " "
    )
    assert (
        "shows 190 (lowest 150, highest 200) images per second on two cores (a processor), release 0.2's 100 (lowest 50, highest 100)."
        in said
    )
    assert said.endswith(
        "The median ratio of 3 rounds is 2.00 (lowest 1.50, highest 3.80), as aimed at."
    )


def test_the_line_of_retraining_is_read_and_not_that_of_whole_frames() -> None:
    text = "retraining, whole frames  320x192      90 images/s (80 to 95)\nretraining                256x160     175 images/s (166 to 175)\n"
    assert retraining_speed.SPEED.findall(text) == ["175"]
