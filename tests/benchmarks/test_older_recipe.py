"""The answer about release 0.2's recipe: counts and the interval by hand."""

from __future__ import annotations

import numpy as np
import older_recipe
import pandas as pd


def test_both_recipes_are_compared_on_the_tests_without_an_error() -> None:
    assert older_recipe.answer(older_recipe.SAME_STEPS, {}) == "No study is published."
    outcomes = {
        "random": [1, 0, 2, 0],
        "adaptive": [0, 0, 0, 0],
        "random-older": [1, 1, 0, 0],
        "adaptive-older": [1, 1, 1, 0],
    }
    table = pd.DataFrame({"scenario": "F1star", "index": np.arange(4), **outcomes})
    text = older_recipe.answer(
        older_recipe.SAME_STEPS, {2: table, 4: table.assign(random=table["random-older"])}
    )
    assert text.splitlines()[-4:-2] == [
        "| 2 | `random` | 3 | 1 | 2 |",
        "| 2 | `adaptive` | 4 | 0 | 3 |",
    ]
    # By seed -1 and -3, then 0 and -3: means of -2 and -1.5, standard error 0.25, t quantile 12.706 with one degree of freedom.
    said = " ".join(text.split())
    assert "a mean difference of -1.8 (-4.9 to +1.4) a training over 2 seeds (95 %)" in said
