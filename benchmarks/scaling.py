"""Speed-up by a second worker, and memory over time.

    python benchmarks/scaling.py [--tests 60] [--scenario F1] [--memory 0]

Executes the same random tests with one worker and with two and compares the wall time. With --memory N, executes N tests in this process
and prints the memory after each tenth of them.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from pipeline.config.composing import compose, functional_scenario
from pipeline.core.space import Space
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import onnx_of
from pipeline.execution.workers import Execution, Setup, Workers
from pipeline.simulators.mujoco.simulator import MujocoSimulator


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tests", type=int, default=60)
    parser.add_argument("--scenario", default="F1")
    parser.add_argument("--memory", type=int, default=0, metavar="N", help="instead, watch the memory over N executions in one process")
    options = parser.parse_args()
    scenario, study = functional_scenario(options.scenario), compose("default", [])
    space = scenario.logical_space()
    with tempfile.TemporaryDirectory() as folder:
        onnx = onnx_of(Path("models/uniform"), Path(folder))
        if options.memory:
            detector = OnnxDetector(onnx, threshold=study.detector["threshold"])
            watch(MujocoSimulator(scenario, compose("default", []).car), detector, space, options.memory)
            return
        seconds = {}
        for count in (1, 2):
            workers = Workers(count, Setup(study.simulator, scenario, study.detector, onnx, study.car, study.limits))
            points = space.sample(options.tests + 2 * count, np.random.default_rng(1))
            jobs = [Execution(i, Path(folder) / f"{count}-{i}.npz", space.decode(point)) for i, point in enumerate(points)]
            list(workers.execute(jobs[: 2 * count]))  # Each worker compiles its world.
            start = time.perf_counter()
            list(workers.execute(jobs[2 * count :]))
            seconds[count] = time.perf_counter() - start
            workers.close()
    gain = seconds[1] / seconds[2]
    print(f"{options.tests} tests: {seconds[1]:.1f} s with one worker, {seconds[2]:.1f} s with two: {gain:.2f} times as fast")


def watch(simulator: MujocoSimulator, detector: OnnxDetector, space: Space, tests: int) -> None:
    """Print the resident memory after each tenth of the executions."""
    for i, point in enumerate(space.sample(tests, np.random.default_rng(1)), 1):
        simulator.execute(space.decode(point), detector)
        if i % max(1, tests // 10) == 0:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            print(f"{i} executions: {pages * 4096 / 2**20:.0f} MiB", flush=True)


if __name__ == "__main__":
    main()
