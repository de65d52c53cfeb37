"""The types of numbers on a command line; argparse reports errors with exit code 2."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from pipeline.errors import shown
from pipeline.scenarios.parts import MOST


def whole(least: int, most: int = MOST) -> Callable[[str], int]:
    """Reads a whole number from `least` to `most`; ArgumentTypeError for another text."""

    def read(text: str) -> int:
        # Python rejects thousands of digits.
        if not text.isdecimal() or len(text) > len(str(most)) or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(
                f"expected a whole number from {least} to {most}, got {shown(text)}"
            )
        return int(text)

    return read
