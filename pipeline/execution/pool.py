"""Worker processes for rendering in parallel."""

from __future__ import annotations

import multiprocessing
import os
from multiprocessing.pool import Pool


def render_pool(processes: int) -> Pool:
    """A pool of workers with one thread each; spawned, because a forked child hangs if its parent has a GL context."""
    return multiprocessing.get_context("spawn").Pool(processes, initializer=_single_threaded)


def _single_threaded() -> None:
    os.environ["OMP_NUM_THREADS"] = "1"
