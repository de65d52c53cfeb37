"""One run at a time in a folder: `./run`, `snakemake` and `test-detector` wait for each other."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from pipeline.artefacts.job_lock import locked

LOCK = Path(".cache/run.lock")
"""Locked by the run at work; holds its name. `./run` uses the same file."""
HELD = "BLINDSPOT_LOCK_HELD"
"""Set to the folder for the processes that a run starts."""


def hold(name: str) -> tuple[int, ...]:
    """Wait for the run at work in this folder, say who it is, and keep others out until this
    process ends.

    Returns the file handles for `pass_fds` of a process that this one starts: the lock then lasts
    until both have ended. There are none if the process that started this one holds the lock.
    """
    if os.environ.get(HELD) == os.getcwd():
        return ()
    LOCK.parent.mkdir(exist_ok=True)
    handle = os.open(LOCK, os.O_RDWR | os.O_CREAT)
    if not locked(handle, block=False):
        other = LOCK.read_text().strip() or "another run"
        print(
            f"blindspot: {other} is running in this folder; waiting for it to finish",
            file=sys.stderr,
            flush=True,
        )
        locked(handle, block=True)
    LOCK.write_text(f"{name} (process {os.getpid()})\n")
    os.environ[HELD] = os.getcwd()
    return (handle,)
