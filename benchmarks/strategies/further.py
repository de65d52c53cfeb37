"""Questions beside the main comparison: fresh seeds, transfer, rare failures, and the thesis' options of evolutionary testing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ablation
import duels

Rows = Sequence[dict[str, Any]]
TRANSFER = {"forest-transfer": "300 tests of F2 known"}
OPTIONS = {
    "evolutionary explore=0.5": "two random parents beside the four worst",
    "evolutionary impact=0.5": "half of the mutations weighted by impact",
    "evolutionary explore=0.5 impact=0.5": "both",
}
RARE = {
    "forest refinements=0 candidates=3000": "no refinements, thrice as many candidates",
    "forest mutants=0.1": "a tenth of the first candidates mutations of failures",
}
"""Strategy -> what differs, in words."""
FILES = ("fresh", "transfer", "rare", "options")
"""Their runs, by the name of the file."""


def markdown(fresh: Rows, transfer: Rows, rare: Rows, options: Rows) -> str:
    """The tables of all."""
    parts = [
        "**Seeds 40 to 59** in the judging worlds:",
        duels.answer(duels.ratios(fresh), [duels.THESIS]),
        "**Transfer**, in worlds of F3 as recorded:",
        ablation.markdown(transfer, TRANSFER, duels.DEFAULT, (120, 300)),
        "**Where failures are rare**, in the development worlds:",
        ablation.markdown(rare, RARE),
        "**Options of `evolutionary`**, in the development worlds:",
        ablation.markdown(options, OPTIONS, "evolutionary"),
    ]
    return "\n\n".join(parts)
