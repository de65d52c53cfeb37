"""One test in a process of its own, with the limits of a test.

Foreign code may raise anything, hang or end its process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from pipeline.core.episode import Episode
from pipeline.core.space import Value
from pipeline.errors import InputError, SimulationError
from pipeline.execution.pool import Pool
from pipeline.execution.worker import Broken, Calls
from pipeline.execution.workers import Setup, guarded


def episode(setup: Setup, concrete: Mapping[str, Value]) -> Episode:
    """The episode of a concrete scenario; InputError if it fails or is over a limit."""
    with Pool(1, partial(_execution, setup), setup.limits) as pool:
        _, result = next(pool.run([concrete]))
    if isinstance(result, Broken):
        raise InputError(f"the scenario cannot be executed: {result.reason}")
    return result


def _execution(setup: Setup, calls: Calls) -> Callable[[Mapping[str, Value]], Episode]:
    tests = guarded(setup, calls)

    def execute(concrete: Mapping[str, Value]) -> Episode:
        try:
            return tests.run(concrete)
        except SimulationError as error:
            raise InputError(f"the scenario cannot be executed: {error}") from error

    return execute
