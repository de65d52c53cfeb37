"""How many threads PyTorch takes in this process."""

from __future__ import annotations

import torch


def use_threads(threads: int) -> None:
    """Let PyTorch compute with so many threads, at least 1, from now on."""
    torch.set_num_threads(threads)
