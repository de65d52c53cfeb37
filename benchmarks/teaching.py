"""Which search, and which of its frames, teach a detector most? Development towns and people only: it chooses, it proves nothing.

    python benchmarks/teaching.py plan                  the commands of every piece, and which are published
    python benchmarks/teaching.py keep shares 0         publish the piece that data/teaching holds
    python benchmarks/teaching.py answer                the tables of docs/results/teaching.md

A piece is one seed, with searches and retrained versions of its own. `shares` compares searches that mix random and forest-guided tests,
`searches` those that look for something else. The other pieces retrain on the searches of `shares`, but choose other frames of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from outcomes import failures, mean_difference, smallest_p
from pieces import Experiment, Piece

SEEDS = range(3)
SHARES = {
    "random": "100 %",
    "share75": "75 %",
    "adaptive": "50 %",
    "share25": "25 %",
    "forest": "0 %",
}
"""Version -> share of random tests in the search that it learns from."""
SELECTIONS = {
    "failures": "of failed tests",
    "causes": "as many of every cause",
    "unsure": "more where unsure",
    "missed": "more where missed",
}
"""Values of `retraining.selection`, in words."""
SEARCHES = {
    "near": "near misses, too",
    "kinds": "new kinds alone",
    "transfer": "after other scenarios",
}
"""Version -> what the search that it learns from looks for, without random tests."""
KINDS = ("shares", *SELECTIONS, "searches")
VERSIONS = ["base", "control", "random", "adaptive"]


def versions(kind: str) -> Sequence[str]:
    """The versions that a kind of piece publishes."""
    if kind == "searches":
        return ["base", "random", *SEARCHES]
    return [*VERSIONS, *(name for name in SHARES if kind == "shares" and name not in VERSIONS)]


def choice(kind: str) -> str:
    """The overrides of a kind of piece."""
    if kind == "shares":
        return ""
    others = " ~arms.share75 ~arms.share25 ~arms.forest"
    if kind != "searches":
        return f" retraining.selection={kind}{others}"
    arms = "".join(f" +arms.{name}={name}" for name in SEARCHES)
    return f" strategies=[random,{','.join(SEARCHES)}] campaign.transfer=[transfer] ~arms.control ~arms.adaptive{others}{arms}"


EXPERIMENT = Experiment(
    "teaching",
    "teaching",
    {
        (kind, seed): f"comparison.seed={50 + seed}{choice(kind)}"
        for seed in SEEDS
        for kind in KINDS
    },
    versions,
)


def answer(pieces: Mapping[Piece, pd.DataFrame]) -> str:
    """Failures after learning from each mixture and each other search, with the difference from random tests, and from each choice of
    frames, with those from all frames alike and from random tests."""
    counts = {piece: failures(table) for piece, table in pieces.items()}
    seeds = [seed for seed in SEEDS if ("shares", seed) in counts]
    if not seeds:
        return "No piece is published."
    lines = [
        f"{len(seeds)} of {len(SEEDS)} searches.",
        "",
        *_header("share of random tests", "random tests"),
    ]
    failed = {
        name: np.array([counts["shares", seed][name] for seed in seeds], float)
        for name in ("base", "control", *SHARES)
    }
    lines += [
        _row(SHARES.get(name, f"`{name}`"), found, failed["random"])
        for name, found in failed.items()
    ]
    lines += ["", _clearest(failed, SHARES, "mixture")]
    if other := [seed for seed in SEEDS if ("searches", seed) in counts]:
        found = {
            name: np.array([counts["searches", seed][name] for seed in other], float)
            for name in versions("searches")
        }
        lines += [
            "",
            f"{len(other)} of {len(SEEDS)} other searches.",
            "",
            *_header("the search looks for", "random tests"),
        ]
        lines += [
            _row(SEARCHES.get(name, f"`{name}`"), row, found["random"])
            for name, row in found.items()
        ]
        lines += ["", _clearest(found, SEARCHES, "search")]
    lines += ["", *_header("frames of the search with 50 %", "all alike", "random tests")]
    for kind, words in {"shares": "all alike", **SELECTIONS}.items():
        chosen = np.array(
            [counts.get((kind, seed), {}).get("adaptive", np.nan) for seed in seeds], float
        )
        if not np.isnan(chosen).all():
            lines.append(_row(words, chosen, failed["adaptive"], failed["random"]))
    return "\n".join(lines)


def _clearest(failed: Mapping[str, np.ndarray], named: Mapping[str, str], what: str) -> str:
    differences = {
        words: failed[name] - failed["random"] for name, words in named.items() if name != "random"
    }
    return f"Smallest p of a {what} against random tests, {smallest_p(differences)}."


def _header(first: str, *others: str) -> list[str]:
    cells = [
        first,
        "failures, by search",
        "mean",
        *(f"minus {other}, mean (95 %)" for other in others),
    ]
    return [f"| {' | '.join(cells)} |", "|---" * len(cells) + "|"]


def _row(words: str, failed: np.ndarray, *others: np.ndarray) -> str:
    """failed: failures by search, (n,), NaN for one that is not published. others: those of other versions, (n,)."""
    known = ~np.isnan(failed)
    listed = ", ".join(
        f"{count:.0f}" if published else "–" for count, published in zip(failed, known, strict=True)
    )
    differences = [mean_difference((failed - other)[known]) for other in others]
    return f"| {' | '.join([words, listed, f'{failed[known].mean():.1f}', *differences])} |"


if __name__ == "__main__":
    EXPERIMENT.main(__doc__, answer)
