"""Hostile code, in a module that worker processes import fast."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

from pipeline.core.detections import Detections
from pipeline.core.encounter import Encounter
from pipeline.core.episode import Frame
from pipeline.core.space import Value
from pipeline.execution.worker import Calls
from pipeline.simulators.analytic import AnalyticWorld

MB = 1_000_000


def sleep() -> None:
    time.sleep(1e6)


def die() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def eat() -> None:
    eaten = []
    while True:
        eaten.append(np.ones(20 * MB, np.uint8))


def complain() -> None:
    raise RuntimeError("no")


def mumble() -> None:
    raise RuntimeError("no " + b"d\xe9tour.png".decode("utf-8", "surrogateescape"))


def leave() -> None:
    sys.exit("good bye")


def nan() -> Detections:
    return Detections(np.full((1, 4), np.nan, np.float32), np.ones(1, np.float32))


def nothing() -> None:
    return None


ACTS: dict[int, tuple[Callable[[], Any], str]] = {
    2: (sleep, "detect timed out after 2 s"),
    3: (die, "process died (SIGSEGV)"),
    4: (complain, "Hostile.detect failed: RuntimeError: no"),
    5: (leave, "Hostile.detect failed: SystemExit: good bye"),
    6: (nan, "Hostile.detect failed: ValueError: boxes must be finite"),
    7: (nothing, "Hostile.detect must return Detections, got NoneType"),
    8: (mumble, r"Hostile.detect failed: RuntimeError: no d\udce9tour.png"),
}
"""What `Hostile` does in tests of this number, and the reason of their error."""
number = 0
"""Of the test at work."""


class Numbered(AnalyticWorld):
    """Tells the detector beside it the number of the test, which is its fog."""

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        global number
        number = int(float(concrete["fog"]))
        return super().reset(concrete, seed)


class Hostile:
    """A foreign class that harms some tests and detects in the others."""

    def __init__(self, model: str) -> None: ...

    def detect(self, frame: Frame) -> Any:
        if number in ACTS:
            return ACTS[number][0]()
        return Detections(np.array([[1, 2, 3, 4]], np.float32), np.array([0.9], np.float32))


class Fails(Hostile):
    """Fails on every frame."""

    def detect(self, frame: Frame) -> Any:
        complain()


class Hangs(Hostile):
    """Never answers."""

    def detect(self, frame: Frame) -> Any:
        sleep()


class Segfault:
    """Crashes when it is made."""

    def __init__(self, model: str) -> None:
        die()

    def detect(self, frame: Frame) -> Any: ...


def dies_once(root: Path, task: int) -> int:
    mark = root / "died"
    if task == 1 and not mark.exists():
        mark.touch()
        die()
    return task * task


def dies(task: int) -> None:
    die()


def harms(calls: Calls) -> Callable[[Callable[[], None]], None]:
    return lambda harm: harm()


def leaking(calls: Calls) -> Callable[[int], int]:
    kept = []

    def leak(task: int) -> int:
        kept.append(np.ones(100 * MB, np.uint8))
        time.sleep(0.5)
        return len(kept)

    return leak


def counting(_: Calls) -> Callable[[int], list[int]]:
    """Counts the threads that each library would take."""

    def threads(_: int) -> list[int]:
        import cv2

        return [cv2.getNumThreads(), *(pool["num_threads"] for pool in threadpool_info())]

    return threads


def greedy(calls: Calls) -> Callable[[bytes], int]:
    """Takes memory without end before it can be given a task."""
    eat()
    return len


def unmakeable(calls: Calls) -> Callable[[int], int]:
    os._exit(3)
