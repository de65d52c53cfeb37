"""A lock that one process holds at a time, on this machine or, on a shared disk that has locks, on
any.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def held(path: Path, wait: Callable[[], None]) -> Iterator[bool]:
    """Hold the lock of a file; gives whether another process held it before.

    It ends with its process, however that ends.

    Args:
        wait: called once before waiting. A disk without locks does not lock. The file is removed
            afterwards.
    """
    file, waited = _opened(path), False
    try:
        while not (locked(file, block=waited) and _same(file, path)):
            if not waited:
                wait()
            waited = True
            if not _same(file, path):  # The process before removed it.
                os.close(file)
                file = _opened(path)
        try:
            yield waited
        finally:  # Not where Ctrl-C ends the waiting: the file is then that of the process at work.
            if _same(file, path):
                path.unlink()
    finally:
        os.close(file)


def _opened(path: Path) -> int:
    path.parent.mkdir(parents=True, exist_ok=True)
    return os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o644)


def locked(file: int, block: bool) -> bool:
    """Lock an open file; false if another process holds its lock and `block` is false.

    A disk without locks does not lock.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if block else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError:  # No locks on this disk.
        pass
    return True


def _same(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False
