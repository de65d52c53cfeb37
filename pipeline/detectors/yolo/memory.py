"""Keeps freed memory in this process, for the next iteration of a training."""

from __future__ import annotations

import ctypes

M_TRIM_THRESHOLD, M_MMAP_MAX = -1, -4
"""Of glibc's malloc.h."""
ALL = 2**31 - 1


def keep_freed_memory() -> None:
    """Ask glibc not to return freed memory to the system.

    Each iteration allocates and frees the same tensors. If their memory goes back, the system
    clears every page again, which took a twelfth of a step on one thread. Other C libraries are
    left alone.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(M_MMAP_MAX, 0)
        mallopt(M_TRIM_THRESHOLD, ALL)
