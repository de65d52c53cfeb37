"""What tests of several folders share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from pipeline.core.coverage import arrays


@pytest.fixture(scope="class")  # Hypothesis refuses one a function.
def short_annealing() -> Iterator[None]:
    """A quick covering array stops after a hundredth of its steps: for tests of anything but its size."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays, "QUICK_OPERATIONS", arrays.QUICK_OPERATIONS / 100)
        yield
