"""The two errors that callers handle: bad input, and a simulation that could not be executed."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input from outside (a key, a file, a machine); its one message says what to do. The command line exits with 2."""


class SimulationError(RuntimeError):
    """The simulation broke. An outcome of its own, never a KPI."""
