"""Sets the number of PyTorch's threads in this process."""

from __future__ import annotations

import torch


def use_threads(threads: int) -> None:
    """Set the number of PyTorch's threads, at least 1."""
    torch.set_num_threads(threads)
