"""README's figures, from the published outcomes: `python benchmarks/headline.py`."""

from __future__ import annotations

from textwrap import fill

import default_study
import numpy as np
import retraining
from outcomes import failures, valid

LINE = 118
BASE = "long_tailed"


def main() -> None:
    studies = default_study.published()
    better = sum(default_study.p_value(piece, "base") <= default_study.ALPHA for piece in studies.outcomes.values())
    minutes = default_study.timed_minutes(studies, default_study.published(default_study.AGAIN))
    pieces = [piece for (base, _), piece in retraining.EXPERIMENT.published().items() if base == BASE]
    left = {name: np.mean([failures(piece)[name] for piece in pieces]) for name in ("base", "random", "adaptive")}
    text = (
        f"In {better} of {len(studies.outcomes)} [default studies](docs/results/default.md), `adaptive` fails significantly less than the "
        f"base, within {min(minutes):.0f} to {max(minutes):.0f} minutes. Adaptive tests teach the long-tailed base more than other images, "
        f"but [no more than random ones](docs/results/retraining.md): it fails {left['base']:.0f} of "
        f"{len(valid(pieces[0]))} held-out tests, `adaptive` {left['adaptive']:.1f}, `random` {left['random']:.1f}. "
        "[Two retrained bases](docs/results/where-it-pays.md) learn more from adaptive tests."
    )
    print(fill(text, LINE, break_long_words=False, break_on_hyphens=False))


if __name__ == "__main__":
    main()
