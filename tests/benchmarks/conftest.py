"""Makes scripts of the folder benchmarks importable. The folder itself must not be on the path: its `coverage.py` would hide a package."""

import importlib
from pathlib import Path

import pytest

with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    for script in (
        "outcomes",
        "pieces",
        "retraining",
        "retraining_speed",
        "default_study",
        "older_recipe",
        "confirmed_rules",
        "teaching",
        "what_is_left",
        "rounds",
        "longer",
        "where_it_pays",
        "front_car",
        "completion",
        "scaling",
        "headline",
    ):
        importlib.import_module(script)
