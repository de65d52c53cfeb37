"""README's figures, from the published outcomes: `python benchmarks/headline.py`."""

from __future__ import annotations

from textwrap import fill

import default_study
import numpy as np
import pandas as pd
import retraining
import where_it_pays
from outcomes import failures, valid

from pipeline.core.statistics import mean_interval

LINE = 118
BASE = "long_tailed"
IMAGES = ("control", "fresh", "balanced")
"""The versions that learnt from other images than those of tests."""


def main() -> None:
    studies = default_study.published()
    better = sum(
        default_study.p_value(piece, "base") <= default_study.ALPHA
        for piece in studies.outcomes.values()
    )
    minutes = default_study.timed_minutes(studies, default_study.published(default_study.AGAIN))
    pieces = [
        piece for (base, _), piece in retraining.EXPERIMENT.published().items() if base == BASE
    ]
    more = [
        table
        for (kind, _), table in where_it_pays.EXPERIMENT.published().items()
        if kind in where_it_pays.MORE
    ]
    print(
        fill(
            text(better, len(studies.outcomes), minutes, pieces, more),
            LINE,
            break_long_words=False,
            break_on_hyphens=False,
        )
    )


def text(
    better: int,
    studies: int,
    minutes: list[float],
    pieces: list[pd.DataFrame],
    more: list[pd.DataFrame],
) -> str:
    """The sentences; SystemExit for one that no longer follows from the outcomes.

    better: default studies with a shown improvement. pieces, more: outcomes of searches on the long-tailed base, and on retrained ones.
    """
    failed = pd.DataFrame(map(failures, pieces))
    left = failed.mean()
    _check(
        "more than other images", all((failed["adaptive"] < failed[name]).all() for name in IMAGES)
    )
    _check(
        "no benefit over random ones", mean_interval(failed["adaptive"] - failed["random"])[1] >= 0
    )
    ahead = [
        100 * (valid(table)["adaptive"].mean() - valid(table)["random"].mean()) for table in more
    ]
    _check("two retrained bases learn more", mean_interval(np.array(ahead))[1] < 0)
    return (
        f"In {better} of {studies} [default studies](docs/results/default.md), `adaptive` fails significantly less than the base, within "
        f"{min(minutes):.0f} to {max(minutes):.0f} minutes. Adaptive tests teach the long-tailed base more than other images; [no benefit "
        f"over random ones](docs/results/retraining.md) is shown: this base fails {left['base']:.0f} of {len(valid(pieces[0]))} held-out "
        f"tests, `adaptive` {left['adaptive']:.1f}, `random` {left['random']:.1f}. [Two retrained bases](docs/results/where-it-pays.md) "
        "learn more from adaptive than from random tests."
    )


def _check(sentence: str, holds: bool) -> None:
    if not holds:
        raise SystemExit(
            f"benchmarks/headline.py: '{sentence}' does not follow from the published outcomes; write another sentence"
        )


if __name__ == "__main__":
    main()
