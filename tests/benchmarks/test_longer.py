"""The table about longer retraining: counts and differences by hand."""

from __future__ import annotations

import longer
import pandas as pd


def piece(base: int, adaptive: int) -> pd.DataFrame:
    """20 tests a scenario; the first ones fail, on F1* twice as many as elsewhere."""
    rows = [
        {
            "scenario": name,
            "index": i,
            "animation": "walking",
            "blueprint": "W 01",
            "base": int(i < base * more),
            "adaptive": int(i < adaptive * more),
        }
        for name in longer.TOWNS
        for more in [2 if name == "F1star" else 1]
        for i in range(20)
    ]
    return pd.DataFrame(rows)


def test_retrainings_are_compared_over_searches_that_have_both() -> None:
    pieces = {
        ("published", 0): piece(4, 3),
        ("longer", 0): piece(4, 2),
        ("published", 1): piece(4, 2),
        ("longer", 1): piece(4, 2),
    }
    text = longer.answer({**pieces, ("published", 2): piece(4, 4)})
    assert text.startswith("2 of 3 searches, 120 held-out tests each.")
    assert "| `base` | 28, 28 | 28.0 | |" in text
    assert (
        "| `adaptive`, 800 steps | 21, 14 | 17.5 | 0.75, 0.50 |" in text
        and "| `adaptive`, 2,400 steps | 14, 14 | 14.0 | 0.50, 0.50 |" in text
    )
    # Differences -7 and 0: mean -3.5, standard error 3.5, t quantile 12.706 with one degree of freedom.
    assert "Longer minus published: -3.5 (-48.0 to +41.0)." in text
    assert "| `adaptive`, 800 steps | 5.0 | 2.5 | 2.5 | 2.5 | 2.5 | 2.5 |" in text
    assert longer.answer({("longer", 0): piece(4, 2)}) == "No search is published."


def test_both_pieces_of_a_seed_differ_by_the_retraining_alone() -> None:
    published, more = (longer.EXPERIMENT.overrides((kind, 0)) for kind in longer.SETTINGS)
    assert more == [*published, "retraining.iterations=2400", "retraining.added_frames=9000"]
