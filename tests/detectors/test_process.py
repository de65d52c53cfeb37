"""A training's process keeps the memory that it frees, and its idle threads leave their cores."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc", reason="other C libraries and their OpenMP are left alone"
)

PAGES = """
import resource
import torch
from pipeline.detectors.yolo.memory import keep_freed_memory
{before}
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(40):
    torch.ones(12_000_000)
known = faults()
for _ in range(10):
    torch.ones(12_000_000)
print(faults() - known)
"""

THREADS = """
import os
import torch
from pipeline.detectors.yolo.threads import end_idle_threads, use_threads
use_threads(3)
def threads():
    return len(os.listdir("/proc/self/task"))
torch.ones(10**6).exp()
print(threads())
end_idle_threads()
print(threads())
torch.ones(10**6).exp()
print(threads())
"""


def test_a_freed_tensor_leaves_its_pages_to_the_next() -> None:
    """Ten of 48 MB each, in pages of 4 KB."""
    assert printed(PAGES.format(before="")) > [100_000]
    assert printed(PAGES.format(before="keep_freed_memory()")) < [100]


def test_idle_threads_end_and_the_next_computation_starts_them_again() -> None:
    at_work, ended, again = printed(THREADS)
    assert at_work == again == ended + 2


def printed(code: str) -> list[int]:
    """The numbers that a new process prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return [int(word) for word in done.stdout.split()]
