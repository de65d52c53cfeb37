"""Progress of long tasks: a bar on a terminal, at most one line per second in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from tqdm import tqdm

LOG_EVERY_S = 1.0
PIPE_EVERY_S = 10.0

OnProgress = Callable[[int, int, str], None]
"""Callback for the progress of long tasks: done, total and a text. `Progress` is one."""


class Progress:
    """Shows the progress of a task: lines in a log file, and on stderr a bar.

    Without a terminal, stderr gets a few lines in place of the bar.
    """

    def __init__(self, label: str, log: Path | None = None) -> None:
        self._label, self._started = label, time.monotonic()
        self._logged = self._piped = float("-inf")
        self._first: tuple[int, float] | None = None
        self._done = 0
        self._bar: tqdm[None] | None = None
        self._log = None
        if log is not None:
            log.parent.mkdir(parents=True, exist_ok=True)
            self._log = log.open("a", buffering=1)

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.close()
        if self._log is not None:
            self._log.close()

    def __call__(self, done: int, total: int, text: str = "") -> None:
        """Report `done` of `total`; the last call, with done = total, is always shown."""
        now = time.monotonic()
        last = done >= total
        # Start-up, and the part that a killed run had done, say nothing about the time left.
        if self._first is None or done < self._done:
            self._first = done, now
        self._done = done
        share = done / total if total else 1.0
        line = f"{self._label} {done}/{total} {share:4.0%} {now - self._started:.0f} s, "
        line += f"{_left(done, total, now, *self._first)} left{', ' + text if text else ''}"
        if self._log is not None and (last or now - self._logged >= LOG_EVERY_S):
            self._logged = now
            self._log.write(line + "\n")
        if sys.stderr.isatty():
            if self._bar is None:
                self._bar = tqdm(
                    total=total, initial=done, desc=self._label, file=sys.stderr, dynamic_ncols=True
                )
            self._bar.total = total
            self._bar.set_postfix_str(text, refresh=False)
            self._bar.update(done - self._bar.n)
        elif last or now - self._piped >= PIPE_EVERY_S:
            self._piped = now
            print(line, file=sys.stderr, flush=True)

    def note(self, text: str) -> None:
        """Write a line to the log and to stderr."""
        self.record(text)
        tqdm.write(f"{self._label}: {text}", file=sys.stderr)

    def record(self, text: str) -> None:
        """Write a line to the log only."""
        if self._log is not None:
            self._log.write(text + "\n")


def _left(done: int, total: int, now: float, first: int, since: float) -> str:
    """The time left at the speed since the first report, as `02:05`."""
    if done >= total:
        return "00:00"
    if done == first:
        return "--:--"
    seconds = int((now - since) / (done - first) * (total - done))
    return f"{seconds // 60:02d}:{seconds % 60:02d}"
