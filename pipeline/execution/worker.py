"""Worker processes that share tasks, watched from outside.

Code in a worker may crash, hang or take all memory: that costs one task and does no harm to the
parent.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import TracebackType
from typing import Generic, TypeVar

from threadpoolctl import threadpool_limits

from pipeline.config.sections import Limits
from pipeline.errors import InputError, explained
from pipeline.execution.one_thread import ONE_THREAD

# Workers are forks of a server process, which imports what they share once. It is no fork of its
# parent, because a forked child hangs if its parent has a GL context.
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(["pipeline.execution.worker_server"])
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
SIGNALS = {number.value: number.name for number in signal.Signals}
START_S = 600.0
"""Longest time that a process takes to import and to build what its tasks need."""
TICK_S = 0.2
"""Longest time between two looks at the processes."""
LONGEST_TICK_S = 1.0
"""Longest time between two looks that counts: a run that was suspended has not been at work."""

Task = TypeVar("Task")
Result = TypeVar("Result")
Calls = ctypes.c_uint64
"""Shared with the parent: odd while foreign code handles a frame; each call adds two."""
Make = Callable[[Calls], Callable[[Task], Result]]
"""Makes, in the process, the function that executes its tasks."""


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
        self.connection, child_end = CONTEXT.Pipe()
        self._process = CONTEXT.Process(
            target=_serve, args=(make, child_end, self._calls, dict(os.environ))
        )
        self._process.start()
        child_end.close()
        self._ready = False
        self._first: Task | None = None

    def give(self, task: Task) -> None:
        """Let the process execute a task."""
        self._task_s = self._call_s = 0.0
        self._last_calls = self._calls.value
        if self._ready:
            self._send(task)
        else:  # It does not listen yet: sending a large task would wait for it without a limit.
            self._first = task

    def _send(self, task: Task) -> None:
        with suppress(OSError):  # If it died while it was idle, `look` reports that.
            self.connection.send(task)

    def look(
        self, seconds: float, limits: Limits | None
    ) -> Done[Result] | Broken | Exception | None:
        """Look at the process, and kill it if it is over a limit.

        Args:
            seconds: time since the last look.
            limits: of the process; None for none.

        Returns:
            The task's result, or why it has none; None while the process is at work. An Exception
            ends all work: bad input, a process that cannot start, or a bug.
        """
        answer: Done[Result] | Broken | Exception | None = None
        if self.connection.poll():
            answer = self._received()
        elif not self._process.is_alive():
            answer = self._died()
        elif limits is not None:
            answer = self._over(seconds, limits)
            if answer is not None:
                self.kill()
        if isinstance(answer, Broken) and not self._ready:
            return InputError(f"a worker process cannot start: {answer.reason}")
        return answer

    def _received(self) -> Done[Result] | Broken | Exception | None:
        try:
            answer: Done[Result] | Exception | None = self.connection.recv()
        except (EOFError, OSError):
            return self._died()
        if not self._ready:
            self._ready, self._task_s = True, 0.0
            if self._first is not None:
                self._send(self._first)
        return answer

    def _died(self) -> Broken:
        self._process.join(1)
        self.kill()
        code = self._process.exitcode or 0
        how = SIGNALS.get(-code, f"signal {-code}") if code < 0 else f"exit code {code}"
        return Broken(f"process died ({how})", again=True)

    def _over(self, seconds: float, limits: Limits) -> Broken | None:
        """The limit that the process is over, if any."""
        calls = self._calls.value
        in_same_call = calls % 2 and calls == self._last_calls
        self._call_s = self._call_s + seconds if in_same_call else 0.0
        self._task_s += seconds
        self._last_calls = calls
        longest = limits.test_s if self._ready else START_S
        if self._call_s > limits.frame_s:
            return Broken(f"detect timed out after {limits.frame_s:g} s", again=False)
        if self._task_s > longest:
            return Broken(f"timed out after {longest:g} s", again=False)
        if _resident_mb(self._process.pid) > limits.memory_mb:
            # Perhaps a leak in earlier tests, so a new process may succeed.
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


def _serve(
    make: Make[Task, Result], connection: Connection, calls: Calls, environment: dict[str, str]
) -> None:
    """Execute tasks until the parent is gone; runs in the worker process.

    environment: the parent's, which may have changed since the server started.
    """
    # Ctrl-C reaches all processes; the parent ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.clear()
    os.environ.update({**environment, **ONE_THREAD})
    threadpool_limits(1)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    try:
        execute = make(calls)
        connection.send(None)
        while True:
            try:
                task = connection.recv()
            except EOFError:
                return
            connection.send(Done(execute(task)))
    except Exception as error:
        explanation = explained(error)
        if explanation is None:
            answer: Exception = RuntimeError(f"in a worker process:\n{traceback.format_exc()}")
        else:
            answer = type(explanation)(str(explanation))
        with suppress(BrokenPipeError):  # The parent was killed a moment ago.
            connection.send(answer)


def _end_with(server: int) -> None:
    """Exit when the server is gone, which ends with its parent, also by kill -9."""
    while os.getppid() == server:
        time.sleep(1)
    os._exit(1)


class Pool(Generic[Task, Result]):
    """Processes that execute tasks, started when they are needed.

    Args:
        count: number of processes, at least 1; else ValueError.
        make: makes, in each process, the function that executes its tasks.
        limits: of each process; None for none.
    """

    def __init__(self, count: int, make: Make[Task, Result], limits: Limits | None = None) -> None:
        if count < 1:
            raise ValueError(f"count must be at least 1 process, got {count}")
        self._count, self._make, self._limits = count, make, limits
        self._idle: list[Worker[Task, Result]] = []
        self._busy: dict[Worker[Task, Result], int] = {}

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Result | Broken]]:
        """Execute the tasks in any order; yields the index and the result of each.

        If a process dies or takes too much memory, its task is executed again, alone in a new
        process: other processes or earlier tasks may be the reason. A task that fails twice, or
        takes too long, is Broken. InputError, and any other exception, ends the work.
        """
        again: list[int] = []
        for index, outcome in self._run(dict(enumerate(tasks)), self._count):
            if isinstance(outcome, Broken) and outcome.again:
                again.append(index)
            else:
                yield index, outcome
        for index in again:
            self.close()
            yield from self._run({index: tasks[index]}, 1)

    def _run(self, tasks: dict[int, Task], count: int) -> Iterator[tuple[int, Result | Broken]]:
        waiting, last = deque(tasks.items()), time.monotonic()
        done: list[tuple[int, Result | Broken]] = []
        while waiting or self._busy:
            while waiting and len(self._busy) < count:
                index, task = waiting.popleft()
                worker = self._idle.pop() if self._idle else Worker(self._make)
                self._busy[worker] = index
                worker.give(task)
            yield from done  # After the processes have work again: the caller takes its time.
            wait([worker.connection for worker in self._busy], TICK_S)
            now = time.monotonic()
            done = self._answers(min(now - last, LONGEST_TICK_S))
            last = now
        yield from done

    def _answers(self, seconds: float) -> list[tuple[int, Result | Broken]]:
        """The results since the last look, which is so many seconds ago."""
        answers: list[tuple[int, Result | Broken]] = []
        for worker in list(self._busy):
            answer = worker.look(seconds, self._limits)
            if isinstance(answer, Exception):
                raise answer
            if answer is None:
                continue
            index = self._busy.pop(worker)
            if isinstance(answer, Broken):
                answers.append((index, answer))
            else:
                self._idle.append(worker)
                answers.append((index, answer.result))
        return answers

    def close(self) -> None:
        """End the processes, also those at work."""
        for worker in [*self._idle, *self._busy]:
            worker.kill()
        self._idle, self._busy = [], {}

    def __enter__(self) -> Pool[Task, Result]:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def in_order(
    function: Callable[[Task], Result], tasks: Sequence[Task], processes: int
) -> Iterator[Result]:
    """The results of a function, computed in processes, in the order of the tasks.

    Raises:
        InputError: if a process dies twice on one task.
    """
    done: dict[int, Result] = {}
    following = 0
    with Pool(min(processes, max(1, len(tasks))), partial(_without_calls, function)) as pool:
        for index, outcome in pool.run(tasks):
            if isinstance(outcome, Broken):
                raise InputError(
                    f"part {index + 1} of {len(tasks)}: {outcome.reason}, twice; "
                    "the same command resumes"
                )
            done[index] = outcome
            while following in done:
                yield done.pop(following)
                following += 1


def _without_calls(function: Callable[[Task], Result], calls: Calls) -> Callable[[Task], Result]:
    return function
