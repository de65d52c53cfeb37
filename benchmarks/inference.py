"""Milliseconds per frame of a detector on one thread: `python benchmarks/inference.py [model.onnx] [--frames 300]`."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from pipeline.core.episode import Frame
from pipeline.core.truth import Truth
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import onnx_of

SIZE = (320, 192)
SHIPPED = Path("models/uniform")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "model",
        type=Path,
        nargs="?",
        help="an ONNX file for 320x192; default: the shipped detector, exported now",
    )
    parser.add_argument("--frames", type=int, default=300)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        detector = OnnxDetector(options.model or onnx_of(SHIPPED, Path(folder)))
        spent = np.array(timings(detector, options.frames)) * 1e3
    print(
        f"{np.median(spent):.2f} ms a frame (median), {np.percentile(spent, 95):.2f} ms (95th percentile), {len(spent)} frames, one thread"
    )


def timings(detector: OnnxDetector, frames: int) -> list[float]:
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (16, SIZE[1], SIZE[0], 3), dtype=np.uint8)
    spent = []
    for number in range(frames + 10):
        start = time.perf_counter()
        detector.detect(Frame(images[number % len(images)], Truth()))
        spent.append(time.perf_counter() - start)
    return spent[10:]


if __name__ == "__main__":
    main()
