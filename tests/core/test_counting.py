"""Counts of cells by bit sets and by histograms against plain counting."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from pipeline.core.coverage.counting import FEW_POINTS, CellCounts


@pytest.mark.parametrize(
    ("sizes", "k"),
    [
        ((3, 4, 2, 5), 1), ((3, 4, 2, 5), 2), ((3, 4, 1, 5, 40), 2), ((3, 4, 2, 5, 40), 3),
        ((4,) * 6, 3), ((2, 3, 1, 4), 3), ((3,) * 5, 4), ((300, 2, 2), 2),
    ],
)  # fmt: skip
@pytest.mark.parametrize("points", [0, 7, FEW_POINTS + 77])
def test_counts_are_right_with_and_without_batches(
    sizes: tuple[int, ...], k: int, points: int
) -> None:
    rng = np.random.default_rng(points)
    rows = np.column_stack([rng.integers(0, size, points) for size in sizes]).reshape(
        points, len(sizes)
    )
    counts = CellCounts(sizes, k)
    counts.add(rows[: points // 3])
    counts.add(rows[points // 3 :])
    assert counts.points == points
    for conditions, plane in counts:
        expected = Counter(map(tuple, rows[:, list(conditions)].tolist()))
        assert plane.sum() == points
        assert all(plane[cell] == expected[cell] for cell in np.ndindex(plane.shape))


def test_a_condition_with_thousands_of_categories_costs_no_memory_beside_its_own_cells() -> None:
    sizes, points = (60_000, 4, 4, 4), FEW_POINTS
    rows = np.column_stack([np.random.default_rng(0).integers(0, size, points) for size in sizes])
    counts = CellCounts(sizes, 3)
    counts.add(
        rows
    )  # The square of the sizes, as bit sets, would be terabytes, which no machine has.
    expected = Counter(map(tuple, rows[:, 1:].tolist()))
    assert all(counts.plane(3)[cell] == expected[cell] for cell in np.ndindex(4, 4, 4))


def test_k_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"k must be in \[1, 2\], got 3"):
        CellCounts((2, 2), 3)
