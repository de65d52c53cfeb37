"""What each part of a strategy is worth: campaigns in the development worlds with one part changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from duels import DEFAULT, SYMBOLS, Duel, kinds, ratio
from picture import BUDGETS

CHANGES = {
    "forest-trees-alone": "no linear model",
    "forest-linear-alone": "no trees",
    "forest-mean": "mean of both models instead of the noisy-or",
    "forest-boosting": "boosted trees",
    "forest-level-set": "level set of a Gaussian process",
    "forest-deep-kernel": "deep kernel instead of the linear model",
    "forest-no-attributes": "no attributes of categories",
    "forest votes=45": "no drawing of trees",
    "forest refinements=0": "no refinements of the candidates",
    "forest refinements=0 candidates=3000": "no refinements, thrice as many candidates",
    "forest mutants=0.1": "a tenth of the first candidates mutations of failures",
    "forest explore=0": "no slots for pairs never tested",
    "forest kinds=0": "no slots for kinds",
    "forest exploitation=0": "no exploitation as new pairs run out",
    "forest diverse=false": "no gain for new pairs",
}
"""Strategy -> what differs from the default, in words."""


def markdown(
    rows: Sequence[dict[str, Any]],
    changes: Mapping[str, str] = CHANGES,
    reference: str = DEFAULT,
    budgets: Sequence[int] = BUDGETS,
) -> str:
    """A table for each measure: the ratio to a strategy, a row for each change, a column for each kind of worlds and budget."""
    groups = {
        kind: group
        for kind, group in kinds(rows, budgets).items()
        if any(reference in block.strategies for block in group)
    }
    tables = []
    for measure, symbol in SYMBOLS.items():
        lines = [
            f"| {symbol}, × `{reference}` | {' | '.join(f'{kind}, {budget:,}' for kind, budget in groups)} |"
        ]
        lines += ["|---" * (len(groups) + 1) + "|"]
        for strategy, words in changes.items():
            cells = [
                str(ratio(group, Duel(measure, strategy, reference)) or "–")
                for group in groups.values()
            ]
            lines.append(f"| {words} | {' | '.join(cells)} |")
        tables.append("\n".join(lines))
    return "\n\n".join(tables)
