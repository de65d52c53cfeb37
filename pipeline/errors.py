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


def missing_extra(error: ModuleNotFoundError) -> InputError | None:
    """The error of a command whose extra is not installed, with the line to type; None for a module that no extra brings."""
    if not error.name:
        return None
    module = error.name.partition(".")[0]
    distribution = DISTRIBUTIONS.get(module, module.replace("_", "-"))
    for requirement in requires("blindspot") or ():
        if found := re.fullmatch(rf"{re.escape(distribution)}\b(?!-).*; extra == [\"'](.+)[\"']", requirement):
            return InputError(f"needs {module}, which is not installed; type: pip install 'blindspot[{found[1]}]'")
    return None
