"""Damage to a text: pieces that replace a few of its characters."""

from __future__ import annotations

from hypothesis import strategies as st

PIECES = [
    "",
    ",",
    '"',
    "\n",
    ";",
    "\t",
    " ",
    "0",
    "1",
    "2",
    ".",
    "-",
    "e",
    "_",
    "a",
    "on",
    "sky",
    "fog",
    "null",
    "~",
    "nan",
    ":",
    "[",
    "]",
    "{",
    "}",
]
PIECES += [
    *"0123456789on ",
    "#",
    "'",
    "!",
    "=",
    "\r",
    "\ufeff",
    "é",
    "- ",
    "1.1",
    "sky,",
    "\n\n",
    ", ",
    '""',
    "&a",
    "*a",
    "<<",
    "---\n",
    "|",
    "?",
]
CHANGES = st.lists(
    st.tuples(st.integers(0, 10_000), st.integers(0, 3), st.sampled_from(PIECES)),
    min_size=1,
    max_size=2,
)


def mutated(text: str, changes: list[tuple[int, int, str]]) -> str:
    """Replace a few characters at some places by other pieces."""
    for place, length, piece in changes:
        start = place % (len(text) + 1)
        text = text[:start] + piece + text[start + length :]
    return text
