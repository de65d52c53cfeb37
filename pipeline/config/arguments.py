"""The types of numbers on a command line; argparse says what is wrong and ends with exit code 2."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from pipeline.errors import shown


def whole(least: int) -> Callable[[str], int]:
    """Reads a whole number from `least`; ArgumentTypeError for another text."""

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"expected a whole number from {least}, got {shown(text)}")
        return int(text)

    return read
