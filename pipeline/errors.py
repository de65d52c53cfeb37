"""The two errors that callers handle: bad input, and a simulation that failed to execute."""

from __future__ import annotations

import re
from importlib.metadata import requires
from typing import Any

LONGEST_VALUE, LONGEST_MESSAGE = 80, 600
"""Characters of a value in a message, and of a message."""


class InputError(ValueError):
    """Bad input from outside (a key, a file, a machine); its message says what to do. The command line exits with 2."""


def shown(value: Any) -> str:
    """A value as a message shows it: one line, without control characters, cut where it is long."""
    text = repr(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}…"


def one_line(error: Exception | str) -> str:
    """A message on one line, without control characters, cut where it is long."""
    text = " ".join("".join(sign if sign.isprintable() else " " for sign in str(error)).split())
    return text if len(text) <= LONGEST_MESSAGE else f"{text[:LONGEST_MESSAGE]}…"


class SimulationError(RuntimeError):
    """A simulation that cannot be executed. The test's outcome is `error`, without a KPI."""


DISTRIBUTIONS = {"PIL": "pillow", "cv2": "opencv-python-headless", "hydra": "hydra-core", "omegaconf": "hydra-core"}
"""Imported name -> distribution, if the two differ by more than a dash."""


def missing_extra(error: ModuleNotFoundError) -> InputError:
    """The error for a user who lacks an extra; raises the original error for a module that no extra provides."""
    module = (error.name or "").partition(".")[0]
    distribution = DISTRIBUTIONS.get(module, module.replace("_", "-"))
    pattern = re.compile(rf"{re.escape(distribution)}\b(?!-).*; extra == [\"'](.+)[\"']")
    found = [match[1] for requirement in requires("blindspot") or () if module and (match := pattern.fullmatch(requirement))]
    if not found:
        raise error
    return InputError(f"needs {module}, which is not installed; type: pip install 'blindspot[{found[0]}]'")
