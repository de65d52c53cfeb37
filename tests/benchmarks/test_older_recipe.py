"""The answer about release 0.2's recipe: counts and the test by hand."""

from __future__ import annotations

import numpy as np
import older_recipe
import pandas as pd


def test_both_recipes_are_compared_on_the_tests_without_an_error() -> None:
    assert older_recipe.answer({}) == "No study is published."
    outcomes = {"random": [1, 0, 2, 0], "adaptive": [0, 0, 0, 0], "random-older": [1, 1, 0, 0], "adaptive-older": [1, 1, 1, 0]}
    table = pd.DataFrame({"scenario": "F1star", "index": np.arange(4), **outcomes})
    text = older_recipe.answer({2: table})
    assert text.splitlines()[-2:] == ["| 2 | `random` | 3 | 1 | 2 |", "| 2 | `adaptive` | 4 | 0 | 3 |"]
    # Four fixes and no regression: p = 2 / 2**4.
    said = " ".join(text.split())
    assert "today's recipe fail 1 of 7 held-out tests, those of release 0.2's 5 (exact McNemar test: p = 0.125)" in said
