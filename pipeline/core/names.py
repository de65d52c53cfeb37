"""Names: the one pattern of all that become a path, a wildcard or a registry entry, hints for unknown ones, and any name in one line."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

from pipeline.errors import shown

FEW = 12
WORD = "[A-Za-z0-9][A-Za-z0-9_]*"
LONGEST_NAME = 60


def check_name(name: str, joints: str = "") -> str:
    """The name, if it is a word of ASCII letters, digits and _ that begins with a letter or digit; ValueError for any other.

    So it means nothing to a shell, a regular expression, a file system or a database. joints: characters that may join several words. Names
    that are themselves joined, as those of versions and tests, have none.
    """
    if len(name) > LONGEST_NAME or not re.fullmatch(
        f"{WORD}(?:[{joints}]{WORD})*" if joints else WORD, name
    ):
        joined = f", joined by {' or '.join(joints)}" if joints else ""
        raise ValueError(
            f"expected letters, digits and _{joined}, at most {LONGEST_NAME}, for use in paths, got {shown(name)}"
        )
    return name


def count_of(number: int, noun: str) -> str:
    """`1 failure`, `2,000 failures`."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def nearest(name: str, known: Iterable[str]) -> str:
    """'; did you mean …?' with the nearest known name, or the list of them, or its beginning."""
    choices = sorted(known)
    if (
        close := difflib.get_close_matches(name, choices, n=1, cutoff=0.5)
        if len(name) <= LONGEST_NAME
        else []
    ):
        return f"; did you mean '{close[0]}'?"
    return f"; known are {', '.join(choices if len(choices) <= FEW else [*choices[:FEW], '…'])}"


def in_one_line(text: str) -> str:
    """The text with line breaks and other signs that do not print written as escapes."""
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)
