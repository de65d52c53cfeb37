"""Worker processes that share tasks; a process that breaks costs one task."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from multiprocessing.connection import wait
from types import TracebackType
from typing import Generic

from pipeline.config.sections import Limits
from pipeline.errors import InputError
from pipeline.execution.worker import Broken, Calls, Make, Result, Task, Worker

TICK_S, LONGEST_TICK_S = 0.2, 1.0
"""Time between two looks at the processes, and the most that counts: a run that was suspended has not been at work."""


class Pool(Generic[Task, Result]):
    """Processes that execute tasks, started when they are needed.

    make: makes in each process what executes its tasks. limits: of each process, None for none. Raises ValueError for no process.
    """

    def __init__(self, count: int, make: Make[Task, Result], limits: Limits | None = None) -> None:
        if count < 1:
            raise ValueError(f"count must be at least 1 process, got {count}")
        self._count, self._make, self._limits = count, make, limits
        self._idle: list[Worker[Task, Result]] = []
        self._busy: dict[Worker[Task, Result], int] = {}

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Result | Broken]]:
        """Execute the tasks in any order; yields the index and the result of each.

        If a process dies or takes too much memory, its task is executed again, alone in a new process: other processes or earlier tasks may
        be the reason. What fails twice, or takes too long, is Broken. InputError, and any other exception, ends the work.
        """
        again: dict[int, Task] = {}
        for index, outcome in self._run(dict(enumerate(tasks)), self._count):
            if isinstance(outcome, Broken) and outcome.again:
                again[index] = tasks[index]
            else:
                yield index, outcome
        for index, task in again.items():
            self.close()
            yield from self._run({index: task}, 1)

    def _run(self, tasks: dict[int, Task], count: int) -> Iterator[tuple[int, Result | Broken]]:
        waiting, last = deque(tasks.items()), time.monotonic()
        done: list[tuple[int, Result | Broken]] = []
        while waiting or self._busy:
            while waiting and len(self._busy) < count:
                self._give(*waiting.popleft())
            yield from done  # After the processes have work again: the caller takes its time.
            wait([worker.connection for worker in self._busy], TICK_S)
            now = time.monotonic()
            done = self._answers(min(now - last, LONGEST_TICK_S))
            last = now
        yield from done

    def _give(self, index: int, task: Task) -> None:
        worker = self._idle.pop() if self._idle else Worker(self._make)
        self._busy[worker] = index
        worker.give(task)

    def _answers(self, seconds: float) -> list[tuple[int, Result | Broken]]:
        found: list[tuple[int, Result | Broken]] = []
        for worker in list(self._busy):
            said = worker.look(seconds, self._limits)
            if isinstance(said, Exception):
                raise said
            if said is None:
                continue
            index = self._busy.pop(worker)
            if isinstance(said, Broken):
                found.append((index, said))
            else:
                self._idle.append(worker)
                found.append((index, said.result))
        return found

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
    """The results of a function, computed in processes, in the order of the tasks; InputError if a process dies twice on one task."""
    done: dict[int, Result] = {}
    following = 0
    with Pool(min(processes, max(1, len(tasks))), partial(_plain, function)) as pool:
        for index, outcome in pool.run(tasks):
            if isinstance(outcome, Broken):
                raise InputError(
                    f"part {index + 1} of {len(tasks)}: {outcome.reason}, twice; the same command resumes"
                )
            done[index] = outcome
            while following in done:
                yield done.pop(following)
                following += 1


def _plain(function: Callable[[Task], Result], calls: Calls) -> Callable[[Task], Result]:
    return function
