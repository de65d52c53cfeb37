"""The examples in the docstrings above the core print what they say."""

from __future__ import annotations

import pytest

from tests.examples import modules_with_examples, run_examples

CORE = "pipeline.core."
OTHERS = [name for name in modules_with_examples("pipeline") if not name.startswith(CORE)]


@pytest.mark.parametrize("module", OTHERS)
def test_examples(module: str) -> None:
    results = run_examples(module)
    assert results.attempted and not results.failed
