"""One worker process, watched from outside: code in it may crash, hang or take all memory without harm to its parent."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Generic, TypeVar

from threadpoolctl import threadpool_limits

from pipeline.config.sections import Limits
from pipeline.errors import InputError, explained

# Spawned, because a forked child hangs if its parent has a GL context.
CONTEXT = multiprocessing.get_context("spawn")
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
SIGNALS = {number.value: number.name for number in signal.Signals}
START_S = 600.0
"""Longest time that a process takes to import and to build what its tasks need."""

Task = TypeVar("Task")
Result = TypeVar("Result")
Calls = ctypes.c_uint64
"""Shared with the parent: odd while foreign code handles a frame; each call adds two."""
Make = Callable[[Calls], Callable[[Task], Result]]
"""Makes in the process what executes its tasks."""


@dataclass(frozen=True)
class Broken:
    """A task without a result. again: whether a second try may succeed."""

    reason: str
    again: bool


@dataclass(frozen=True)
class Done(Generic[Result]):
    """A task's result."""

    result: Result


class Worker(Generic[Task, Result]):
    """A process that executes one task at a time."""

    def __init__(self, make: Make[Task, Result]) -> None:
        self._calls = CONTEXT.RawValue(Calls, 0)
        self.connection, theirs = CONTEXT.Pipe()
        self._process = CONTEXT.Process(
            target=_serve, args=(make, theirs, self._calls, os.getpid())
        )
        self._process.start()
        theirs.close()
        self._ready = False
        self._first: Task | None = None

    def give(self, task: Task) -> None:
        """Let the process execute a task."""
        self._task_s = self._call_s = 0.0
        self._seen = self._calls.value
        if self._ready:
            self._send(task)
        else:  # It does not listen yet, and sending a large task would wait for it without a limit.
            self._first = task

    def _send(self, task: Task) -> None:
        with suppress(OSError):  # If it died while it had nothing to do, `look` tells.
            self.connection.send(task)

    def look(
        self, seconds: float, limits: Limits | None
    ) -> Done[Result] | Broken | Exception | None:
        """The task's result, or why it has none; None while the process is at work.

        seconds: since the last look. A process over a limit is killed. An Exception ends all work: bad input, a process that cannot start,
        or a bug.
        """
        said = self._received() if self.connection.poll() else self._broken(seconds, limits)
        if isinstance(said, Broken) and not self._ready:
            return InputError(f"a worker process cannot start: {said.reason}")
        return said

    def _received(self) -> Done[Result] | Broken | Exception | None:
        try:
            said: Done[Result] | Exception | None = self.connection.recv()
        except (EOFError, OSError):
            return self._died()
        if not self._ready:
            self._ready, self._task_s = True, 0.0
            if self._first is not None:
                self._send(self._first)
        return said

    def _broken(self, seconds: float, limits: Limits | None) -> Broken | None:
        if not self._process.is_alive():
            return self._died()
        over = None if limits is None else self._over(seconds, limits)
        if over is not None:
            self.kill()
        return over

    def _died(self) -> Broken:
        self._process.join(1)
        self.kill()
        code = self._process.exitcode or 0
        how = SIGNALS.get(-code, f"signal {-code}") if code < 0 else f"exit code {code}"
        return Broken(f"process died ({how})", again=True)

    def _over(self, seconds: float, limits: Limits) -> Broken | None:
        calls = self._calls.value
        self._task_s += seconds
        self._call_s = self._call_s + seconds if calls % 2 and calls == self._seen else 0.0
        self._seen = calls
        longest = limits.test_s if self._ready else START_S
        if self._call_s > limits.frame_s:
            return Broken(f"detect timed out after {limits.frame_s:g} s", again=False)
        if self._task_s > longest:
            return Broken(f"timed out after {longest:g} s", again=False)
        if (
            _resident_mb(self._process.pid) > limits.memory_mb
        ):  # Perhaps a leak in earlier tests, so a new process may succeed.
            return Broken(f"took more than {limits.memory_mb} MB of memory", again=True)
        return None

    def kill(self) -> None:
        """End the process now."""
        self._process.kill()
        self._process.join(5)
        self.connection.close()


def _resident_mb(pid: int | None) -> float:
    """Resident memory of a process in MB; 0 if it is gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_BYTES / 1e6
    except (OSError, IndexError):
        return 0.0


def _serve(make: Make[Task, Result], connection: Connection, calls: Calls, parent: int) -> None:
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches all processes; the parent ends its workers.
    # With several threads, sums depend on their number; and the processes already share the cores.
    os.environ.update(OMP_NUM_THREADS="1", OPENCV_FOR_THREADS_NUM="1", LP_NUM_THREADS="0")
    threadpool_limits(1)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    try:
        execute = make(calls)
        connection.send(None)
        while (task := _next(connection)) is not None:
            connection.send(Done(execute(task)))
    except Exception as error:
        told = explained(error)
        connection.send(
            RuntimeError(f"in a worker process:\n{traceback.format_exc()}")
            if told is None
            else type(told)(str(told))
        )


def _next(connection: Connection) -> Any:
    """The next task; None if the parent is gone."""
    try:
        return connection.recv()
    except EOFError:
        return None


def _end_with(parent: int) -> None:
    """Exit when the parent is gone: a parent killed by kill -9 cannot end its workers."""
    while os.getppid() == parent:
        time.sleep(1)
    os._exit(1)
