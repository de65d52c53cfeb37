"""Names that become a path, a wildcard or a registry entry, and hints for unknown names."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

from pipeline.errors import shown

FEW = 12
WORD = "[A-Za-z0-9][A-Za-z0-9_]*"
LONGEST_NAME = 60


def check_name(name: str, joints: str = "") -> str:
    """The name, if it means nothing to a shell, a regular expression, a file system or a database.

    Args:
        name: a word of ASCII letters, digits and _ that begins with a letter or digit.
        joints: characters that may join several words. Names that are parts of joined names, as
            those of versions and tests, have none.

    Raises:
        ValueError: any other name.
    """
    pattern = f"{WORD}(?:[{joints}]{WORD})*" if joints else WORD
    if len(name) > LONGEST_NAME or not re.fullmatch(pattern, name):
        joined = f", joined by {' or '.join(joints)}" if joints else ""
        raise ValueError(
            f"expected letters, digits and _{joined}, at most {LONGEST_NAME}, for use in paths, "
            f"got {shown(name)}"
        )
    return name


def count_of(number: int, noun: str) -> str:
    """`1 failure`, `2,000 failures`."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def nearest(name: str, names: Iterable[str]) -> str:
    """'; did you mean …?' with the nearest of the names, or the list of them, or its beginning.

    >>> nearest("sed", ["seeds", "study"])
    "; did you mean 'seeds'?"
    """
    choices = sorted(names)
    close = []
    if len(name) <= LONGEST_NAME:
        close = difflib.get_close_matches(name, choices, n=1, cutoff=0.5)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; known are {', '.join(choices if len(choices) <= FEW else [*choices[:FEW], '…'])}"


def in_one_line(text: str) -> str:
    """The text with line breaks and other signs that do not print written as escapes."""
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)
