"""Which confidence threshold to brake at: `python benchmarks/threshold.py [--tests 40] [--threshold 0.6 0.7 0.8]`.

Runs the same random tests of the search scenarios with the shipped detector at each threshold. Prints the failures, and those caused by
false positives alone, which are the price of a lower threshold.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from pipeline.config.composing import compose, functional_scenario
from pipeline.core import kpi
from pipeline.core.identity import CampaignId
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import onnx_of
from pipeline.execution.campaign import sampler_seed
from pipeline.progress import Progress
from pipeline.simulators.mujoco.simulator import MujocoSimulator

SHIPPED = Path("models/uniform")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tests", type=int, default=40, help="tests per scenario")
    parser.add_argument("--scenario", nargs="+", default=[f"F{number}" for number in range(1, 9)])
    parser.add_argument("--threshold", nargs="+", type=float, default=[0.6, 0.7, 0.8])
    options = parser.parse_args()
    failure_threshold_s = compose("default", []).campaign.failure_threshold_s
    modes: dict[float, Counter[str]] = {threshold: Counter() for threshold in options.threshold}
    tests = options.tests * len(options.scenario)
    with tempfile.TemporaryDirectory() as folder, Progress("threshold") as progress:
        onnx = onnx_of(SHIPPED, Path(folder))
        detectors = {
            threshold: OnnxDetector(onnx, threshold=threshold) for threshold in options.threshold
        }
        for order, scenario in enumerate(options.scenario):
            described = functional_scenario(scenario)
            space = described.logical_space()
            simulator = MujocoSimulator(described, compose("default", []).car)
            points = space.sample(
                options.tests,
                np.random.default_rng(sampler_seed(CampaignId(scenario, "random", "base", 0))),
            )
            for done, point in enumerate(points, start=order * options.tests + 1):
                for threshold, detector in detectors.items():
                    signals = simulator.execute(space.decode(point), detector).signals
                    modes[threshold][kpi.evaluate(signals, failure_threshold_s).failure_mode] += 1
                progress(done, tests)
            simulator.close()
    print(
        f"{'threshold':<11}{'failures':>9}{'contact':>9}{'late':>6}{'false positives':>17}   of {tests} tests"
    )
    for threshold, found in modes.items():
        failures = tests - found["none"]
        print(
            f"{threshold:<11g}{failures:>9}{found['contact']:>9}{found['late']:>6}{found['false_positives']:>17}"
        )


if __name__ == "__main__":
    main()
