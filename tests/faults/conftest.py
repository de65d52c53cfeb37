"""Makes the fault benchmarks importable. Their folder itself must not be on the path: its `coverage.py` would hide a package."""

import importlib
from pathlib import Path

import pytest

with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    for name in (
        "damage_faults",
        "config_faults",
        "kill_faults",
        "repair_faults",
        "cluster_faults",
    ):
        importlib.import_module(name)
