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
    """Shows calls with (done, total, text): as lines in the log file, and on stderr as a bar or, without a terminal, as a few lines."""

    def __init__(self, label: str, log: Path | None = None) -> None:
        self._label, self._started = label, time.monotonic()
        self._logged = self._piped = float("-inf")
        self._bar: tqdm[None] | None = None
        self._log = None
        if log is not None:
            log.parent.mkdir(parents=True, exist_ok=True)
            self._log = log.open("a", buffering=1)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.close()
        if self._log is not None:
            self._log.close()

    def __call__(self, done: int, total: int, text: str = "") -> None:
        """Report `done` of `total`; the last call, with done = total, is always shown."""
        now = time.monotonic()
        last = done >= total
        line = self._line(done, total, text, now - self._started)
        if self._log is not None and (last or now - self._logged >= LOG_EVERY_S):
            self._logged = now
            self._log.write(line + "\n")
        if sys.stderr.isatty():
            self._draw(done, total, text)
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

    def _draw(self, done: int, total: int, text: str) -> None:
        if self._bar is None:
            self._bar = tqdm(total=total, desc=self._label, file=sys.stderr, dynamic_ncols=True)
        self._bar.total = total
        self._bar.set_postfix_str(text, refresh=False)
        self._bar.update(done - self._bar.n)

    def _line(self, done: int, total: int, text: str, elapsed: float) -> str:
        share = done / total if total else 1.0
        left = elapsed / share - elapsed if share else float("nan")
        rest = f"{int(left) // 60:02d}:{int(left) % 60:02d}" if share else "--:--"
        return f"{self._label} {done}/{total} {share:4.0%} {elapsed:.0f} s, {rest} left{', ' + text if text else ''}"
