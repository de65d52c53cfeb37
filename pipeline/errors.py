"""The two errors that callers handle: bad input, and a simulation that could not be executed."""

from __future__ import annotations

import re
from importlib.metadata import requires


class InputError(ValueError):
    """Bad input from outside (a key, a file, a machine); its one message says what to do. The command line exits with 2."""


class SimulationError(RuntimeError):
    """The simulation broke. An outcome of its own, never a KPI."""


DISTRIBUTIONS = {"PIL": "pillow", "cv2": "opencv-python-headless", "hydra": "hydra-core", "omegaconf": "hydra-core"}
"""Imported name -> distribution, where the two differ by more than a dash."""


def missing_extra(error: ModuleNotFoundError) -> InputError:
    """What to tell a user who lacks an extra; raises the error itself for a module that no extra brings."""
    module = (error.name or "").partition(".")[0]
    distribution = DISTRIBUTIONS.get(module, module.replace("_", "-"))
    pattern = re.compile(rf"{re.escape(distribution)}\b(?!-).*; extra == [\"'](.+)[\"']")
    found = [match[1] for requirement in requires("blindspot") or () if module and (match := pattern.fullmatch(requirement))]
    if not found:
        raise error
    return InputError(f"needs {module}, which is not installed; type: pip install 'blindspot[{found[0]}]'")
