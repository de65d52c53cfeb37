"""PyTorch's threads in this process."""

from __future__ import annotations

import ctypes

import torch

HARD = 2
"""Of OpenMP's omp_pause_resource_t: end the threads."""


def use_threads(threads: int) -> None:
    """Set the number of PyTorch's threads, at least 1."""
    torch.set_num_threads(threads)


def end_idle_threads() -> None:
    """End the threads that wait for PyTorch's next computation, which starts new ones.

    They spin for milliseconds before they sleep, on cores that this process needs for something
    else. An OpenMP library that cannot end them keeps them.
    """
    pause = getattr(ctypes.CDLL(None), "omp_pause_resource_all", None)
    if pause is not None:
        pause(HARD)
