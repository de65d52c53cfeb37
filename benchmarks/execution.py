"""CPU-seconds of a closed-loop test, by part.

    python -m benchmarks.execution [--tests 40] [--scenario F1 ...] [--model models/uniform]
                                   [--camera 640x384]

Runs random tests in one process with one thread and times the parts of each frame. It is CPU time,
not wall time, so that other load on the machine matters little.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pipeline.config.components import make_world
from pipeline.config.composing import compose, functional_scenario
from pipeline.config.schema import Config
from pipeline.core.loop import run_test
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import export_onnx
from pipeline.detectors.yolo.weights import load_weights
from pipeline.simulators.mujoco import camera, lens
from pipeline.simulators.mujoco.world import MujocoWorld

SPENT: dict[str, float] = defaultdict(float)


def timed(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, its CPU time added to `SPENT[name]`."""

    def wrapper(*arguments: Any, **named: Any) -> Any:
        start = time.process_time()
        result = function(*arguments, **named)
        SPENT[name] += time.process_time() - start
        return result

    return wrapper


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tests", type=int, default=40, help="tests per scenario")
    parser.add_argument("--scenario", nargs="+", default=["F1", "F2"])
    parser.add_argument("--model", type=Path, default=Path("models/uniform"))
    parser.add_argument(
        "--camera", default="320x192", help="name of a file in conf/camera (default: %(default)s)"
    )
    options = parser.parse_args()
    config = compose("default", [f"camera={options.camera}"])
    for kind, method, part in (
        (camera.Camera, "shoot", "frame"),
        (camera.Camera, "_truth", "ground truth"),
        (lens.Lens, "expose", "weather"),
        (OnnxDetector, "detect", "inference"),
    ):
        setattr(kind, method, timed(part, getattr(kind, method)))
    with tempfile.TemporaryDirectory() as folder:
        onnx, settings = Path(folder) / "model.onnx", config.simulator["camera"]
        # At the camera's size, whatever size the weights learnt from: the cost is the same.
        export_onnx(
            onnx,
            load_weights(options.model / "weights.safetensors"),
            (settings["width"], settings["height"]),
        )
        for name in options.scenario:
            measure(config, name, options.tests, OnnxDetector(onnx, threshold=config.threshold))


def measure(config: Config, name: str, tests: int, detector: OnnxDetector) -> None:
    """Time one scenario."""
    described = functional_scenario(name)
    space = described.logical_space()
    cv2.setNumThreads(1)  # As in worker processes; waiting threads count as CPU time.
    world = make_world(config.simulator, described, config.car.vehicle)
    assert isinstance(world, MujocoWorld)
    warm_up = space.sample(1, np.random.default_rng(0))[0]
    run_test(world, detector, config.car, space.decode(warm_up))
    SPENT.clear()
    whole, frames = [], 0
    for point in space.sample(tests, np.random.default_rng(1)):
        start = time.process_time()
        episode = run_test(world, detector, config.car, space.decode(point))
        whole.append(time.process_time() - start)
        frames += len(episode.signals["time_s"]) - 1
    world.close()
    render = SPENT["frame"] - SPENT["ground truth"] - SPENT["weather"]
    parts = {
        "render": render,
        "ground truth": SPENT["ground truth"],
        "weather": SPENT["weather"],
        "inference": SPENT["inference"],
    }
    parts["rest"] = sum(whole) - sum(parts.values())
    spread = f"median; mean {np.mean(whole):.2f}, longest {max(whole):.2f}"
    print(f"{name}: {np.median(whole):.2f} CPU-s a test ({spread}), {frames / tests:.1f} frames")
    for part, seconds in parts.items():
        print(f"  {part:<13}{seconds / frames * 1e3:6.2f} ms per frame {seconds / sum(whole):6.1%}")


if __name__ == "__main__":
    main()
