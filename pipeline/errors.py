"""The two errors that callers handle: bad input, and a simulation that failed to execute."""

from __future__ import annotations

import re
from importlib.metadata import requires


class InputError(ValueError):
    """Bad input from outside (a key, a file, a machine); its message says what to do. The command line exits with 2."""


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
