"""The errors that callers handle: bad input, a failed simulation, and a run without a result."""

from __future__ import annotations

import errno
import re
import sys
from importlib.metadata import requires
from pathlib import Path
from typing import Any

LONGEST_VALUE, LONGEST_MESSAGE = 80, 600
"""Characters of a value in a message, and of a message."""


class InputError(ValueError):
    """Bad input from outside (a key, a file, a machine); its message says what to do.

    The command line exits with 2.
    """


def shown(value: Any) -> str:
    """A value as a message shows it: one line, without control characters, cut where it is long."""
    text = repr(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[:LONGEST_VALUE]}…"


def one_line(error: Exception | str) -> str:
    """A message on one line, without control characters, cut where it is long."""
    printable = (sign if sign.isprintable() else " " for sign in str(error))
    text = " ".join("".join(printable).split())
    return text if len(text) <= LONGEST_MESSAGE else f"{text[:LONGEST_MESSAGE]}…"


class SimulationError(RuntimeError):
    """A simulation that cannot be executed. The test's outcome is `error`, without a KPI."""


class NoResultError(RuntimeError):
    """All tests of a campaign ended in an error. The command line exits with 1."""


MACHINE = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EROFS: "the disk is read-only",
    errno.EACCES: "no permission",
    errno.EPERM: "no permission",
    errno.EMFILE: "too few file handles; raise the limit with `ulimit -n`",
    errno.ENFILE: "the machine has no file handles left",
    errno.EIO: "the disk cannot be read or written",
}
"""The state of the machine after a failed system call, by error number."""


def machine_error(error: BaseException) -> InputError | None:
    """The error for a machine that lacks room, rights or handles; None for any other exception."""
    if not isinstance(error, OSError) or error.errno not in MACHINE:
        return None
    place = "" if error.filename is None else f"{error.filename}: "
    return InputError(f"{place}{MACHINE[error.errno]}; the same command resumes")


def explained(error: Exception) -> InputError | NoResultError | None:
    """The error that a user can act on without a traceback; None for a fault of the program."""
    return error if isinstance(error, InputError | NoResultError) else machine_error(error)


DISTRIBUTIONS = {
    "PIL": "pillow",
    "cv2": "opencv-python-headless",
    "hydra": "hydra-core",
    "omegaconf": "hydra-core",
}
"""Imported name -> distribution, if the two differ by more than a dash."""


def missing_extra(error: ModuleNotFoundError) -> InputError:
    """The error for a module that an extra or the checkout's environment provides.

    Raises:
        ModuleNotFoundError: the given error, if neither provides the module.
    """
    module = (error.name or "").partition(".")[0]
    distribution = DISTRIBUTIONS.get(module, module.replace("_", "-"))
    pattern = re.compile(rf"{re.escape(distribution)}\b(?!-).*; extra == [\"'](.+)[\"']")
    for requirement in requires("blindspot") or () if module else ():
        if match := pattern.fullmatch(requirement):
            return InputError(
                f"needs {module}, which is not installed; type: pip install 'blindspot[{match[1]}]'"
            )
    forgotten = sys.prefix == sys.base_prefix and (Path(__file__).parents[1] / ".venv").is_dir()
    if forgotten and module not in ("", "pipeline"):
        return InputError(
            f"needs {module}, which this Python lacks; type: source .venv/bin/activate"
        )
    raise error
