"""Hints for unknown names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

FEW = 12


def nearest(name: str, known: Iterable[str]) -> str:
    """'; did you mean …?' with the nearest known name, or the list of them, or its beginning."""
    choices = sorted(known)
    if close := difflib.get_close_matches(name, choices, n=1, cutoff=0.5):
        return f"; did you mean '{close[0]}'?"
    return f"; known are {', '.join(choices if len(choices) <= FEW else [*choices[:FEW], '…'])}"
