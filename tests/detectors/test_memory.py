"""A training's process keeps the memory that it frees."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

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


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries are left alone")
def test_a_freed_tensor_leaves_its_pages_to_the_next() -> None:
    """Ten of 48 MB each, in pages of 4 KB."""
    assert faults("") > 100_000
    assert faults("keep_freed_memory()") < 100


def faults(before: str) -> int:
    done = subprocess.run([sys.executable, "-c", PAGES.format(before=before)], capture_output=True, text=True, check=True)
    return int(done.stdout)
