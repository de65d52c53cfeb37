"""One run at a time in a folder: `./run`, `snakemake` and `test-detector` wait for each other."""

from __future__ import annotations

import fcntl
import os
import sys
from pathlib import Path

LOCK = Path(".cache/run.lock")
"""Locked by the run at work; holds its name. `./run` uses the same file."""
HELD = "BLINDSPOT_LOCK_HELD"
"""Set to the folder for the processes that a run starts."""


def hold(name: str) -> None:
    """Wait for the run at work in this folder, say who it is, and keep others out until this process ends."""
    if os.environ.get(HELD) == os.getcwd():
        return
    LOCK.parent.mkdir(exist_ok=True)
    handle = os.open(LOCK, os.O_RDWR | os.O_CREAT)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        other = LOCK.read_text().strip() or "another run"
        print(f"blindspot: {other} is running in this folder; waiting for it to finish", file=sys.stderr, flush=True)
        fcntl.flock(handle, fcntl.LOCK_EX)
    LOCK.write_text(f"{name} (process {os.getpid()})\n")
    os.environ[HELD] = os.getcwd()
