"""README's sentences follow from outcomes, or are not printed."""

from __future__ import annotations

import headline
import pandas as pd
import pytest

from tests.benchmarks.test_where_it_pays import piece

PIECES = [
    piece(base=20, control=15, fresh=16, balanced=14, random=count, adaptive=10)
    for count in (9, 10, 11)
]
MORE = [piece(random=5, adaptive=count) for count in (1, 2, 3)]


def said(pieces: list[pd.DataFrame], more: list[pd.DataFrame]) -> str:
    return headline.text(9, 10, [8.6, 19.2], pieces, more)


def test_the_numbers_are_those_of_the_outcomes() -> None:
    assert said(PIECES, MORE).startswith("In 9 of 10 [default studies](docs/results/default.md)")
    assert "within 9 to 19 minutes" in said(PIECES, MORE)
    assert "this base fails 20 of 50 held-out tests, `adaptive` 10.0, `random` 10.0" in said(
        PIECES, MORE
    )


@pytest.mark.parametrize(
    ("pieces", "more", "wrong"),
    [
        (
            [*PIECES, piece(base=20, control=9, fresh=16, balanced=14, random=10, adaptive=10)],
            MORE,
            "more than other images",
        ),
        (
            [
                piece(base=20, control=19, fresh=19, balanced=19, random=9 + s, adaptive=2 + s % 2)
                for s in range(4)
            ],
            MORE,
            "no benefit over random",
        ),
        (
            PIECES,
            [piece(random=5, adaptive=count) for count in (1, 5, 9)],
            "two retrained bases learn more",
        ),
    ],
)
def test_a_sentence_that_no_longer_follows_is_not_printed(
    pieces: list[pd.DataFrame], more: list[pd.DataFrame], wrong: str
) -> None:
    with pytest.raises(SystemExit, match=wrong):
        said(pieces, more)
