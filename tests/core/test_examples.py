"""The examples in the core's docstrings print what they say."""

from __future__ import annotations

import pytest

from tests.examples import modules_with_examples, run_examples


@pytest.mark.parametrize("module", modules_with_examples("pipeline/core"))
def test_examples(module: str) -> None:
    results = run_examples(module)
    assert results.attempted and not results.failed
