"""Makes the benchmark `faults` importable; see the conftest of tests/benchmarks."""

import importlib
from pathlib import Path

import pytest

with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    importlib.import_module("faults")
