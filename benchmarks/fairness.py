"""Is the world fair? How often the visible-pixel oracle, or a detector, fails in random tests.

python benchmarks/fairness.py [--tests 300] [--scenario F1 F2] [--detector oracle|models/base]
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from tqdm import tqdm

from pipeline.config.composing import compose, functional_scenario
from pipeline.core import kpi
from pipeline.core.statistics import wilson_interval
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.detectors.yolo.export import onnx_of
from pipeline.execution.campaign import sampler_seed
from pipeline.protocols import Detector
from pipeline.simulators.mujoco.simulator import MujocoSimulator


def detector_named(name: str, folder: Path) -> Detector:
    """The oracle, or the detector of a model folder."""
    if name == "oracle":
        return VisiblePixelOracle()
    return OnnxDetector(onnx_of(Path(name), folder), threshold=compose("default", []).detector["threshold"])


def main() -> None:
    """Execute random tests and print failures by mode."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tests", type=int, default=300, help="tests per scenario")
    parser.add_argument("--scenario", nargs="+", default=["F1", "F2"])
    parser.add_argument("--detector", default="oracle")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        detector = detector_named(options.detector, Path(folder))
        for name in options.scenario:
            described = functional_scenario(name)
            space, simulator = described.logical_space(), MujocoSimulator(described)
            points = space.sample(options.tests, np.random.default_rng(sampler_seed(name, 5)))
            modes: Counter[str] = Counter()
            for point in tqdm(points, desc=name, unit="test", mininterval=2):
                concrete = space.decode(point)
                outcome = kpi.evaluate(simulator.execute(concrete, detector).signals, 0.1)
                if outcome.failure:
                    modes[outcome.failure_mode] += 1
                    words = [f"'{key}={value}'" if isinstance(value, str) else f"{key}={value:.4g}" for key, value in concrete.items()]
                    tqdm.write(f"{outcome.failure_mode}: python -m pipeline simulate {name} {' '.join(words)}")
            simulator.close()
            failures = sum(modes.values())
            low, high = wilson_interval(failures, options.tests)
            print(f"{name}: {failures} of {options.tests} fail ({low:.1%} to {high:.1%}); {dict(modes)}", flush=True)


if __name__ == "__main__":
    main()
