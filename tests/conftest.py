"""Fixtures that several folders share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from pipeline.core.coverage import arrays


@pytest.fixture(scope="class")  # Hypothesis rejects function-scoped fixtures.
def short_annealing() -> Iterator[None]:
    """Stop quick covering arrays after a hundredth of their steps, for tests that do not depend on the array's size."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays, "QUICK_OPERATIONS", arrays.QUICK_OPERATIONS / 100)
        yield
