"""Training speed in images per second, by phase: `python benchmarks/training.py [--threads 2] [--batch 32] [--seconds 20]`."""

from __future__ import annotations

import argparse
import time

import numpy as np

from pipeline.artefacts.dataset import ImageSet, image_set
from pipeline.core.truth import Truth
from pipeline.detectors.yolo.data import batch
from pipeline.detectors.yolo.recipe import CROP_SIZE
from pipeline.detectors.yolo.training import Batch, Feed, Lesson, Run, Schedule, fit, initial_model

FRAME_SIZE = (320, 192)
WARM_UP = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--seconds", type=float, default=20.0, help="approximate seconds per phase")
    options = parser.parse_args()
    images, run = people(200), Run(threads=options.threads)
    for name, size, frozen in (("crops", CROP_SIZE, False), ("full frames", FRAME_SIZE, False), ("retraining", FRAME_SIZE, True)):
        made = augmentation(images, size, options.batch)

        def shown(iteration: int, size: tuple[int, int] = size) -> Batch:
            return batch(images, np.arange(options.batch) % len(images), size, (iteration,))

        trained = options.batch * training(shown, frozen, options.seconds, run)
        width, height = size
        print(f"{name:12} {width}x{height}  {trained:6.0f} images/s trained, {made:6.0f} images/s augmented on one core")


def people(count: int) -> ImageSet:
    """Noise with a rectangle: the content of the images does not affect the speed."""
    rng = np.random.default_rng(0)
    box = (140.0, 60.0, 165.0, 120.0)
    truth = Truth(box, box, 1500, 1500, 40.0)
    return image_set([(rng.integers(0, 255, (192, 320, 3), dtype=np.uint8), truth) for _ in range(count)])


def augmentation(images: ImageSet, size: tuple[int, int], count: int) -> float:
    start = time.perf_counter()
    for number in range(10):
        batch(images, np.arange(count) % len(images), size, (number,))
    return 10 * count / (time.perf_counter() - start)


def training(shown: Feed, frozen: bool, seconds: float, run: Run) -> float:
    """Iterations per second after a warm-up, batches and optimiser included. frozen: freeze the normalisation's statistics."""

    def feed(iteration: int) -> Batch:
        times.append(time.perf_counter())
        return shown(iteration)

    times: list[float] = []
    fit(initial_model(0), Lesson(Schedule(0, WARM_UP + 2, 1e-3, frozen_statistics=frozen), feed), run)
    iterations = WARM_UP + max(2, round(seconds / (times[-1] - times[-2])))
    times.clear()
    fit(initial_model(0), Lesson(Schedule(0, iterations, 1e-3, frozen_statistics=frozen), feed), run)
    return (iterations - WARM_UP) / (time.perf_counter() - times[WARM_UP])


if __name__ == "__main__":
    main()
