"""Training speed in images per second: `python benchmarks/training.py [--rounds 5] [--threads 2] [--batch 32] [--seconds 10]`.

The recipes take turns, so that a busy machine slows all of them alike. `retraining, whole frames` is how release 0.2 retrained: every
layer, on uncropped frames.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from pipeline.artefacts.dataset import ImageSet, image_set
from pipeline.core.truth import Truth
from pipeline.detectors.yolo.data import batch
from pipeline.detectors.yolo.recipe import CROP_SIZE
from pipeline.detectors.yolo.retraining import crop_of
from pipeline.detectors.yolo.training import Batch, Feed, Lesson, Run, Schedule, fit, initial_model

FRAME_SIZE = (320, 192)
WARM_UP = 3


@dataclass(frozen=True)
class Recipe:
    """size: width and height of the shown images. retraining: freezes the normalisation's statistics. all_layers: trains the first stage,
    too."""

    size: tuple[int, int]
    retraining: bool = False
    all_layers: bool = True


RECIPES = {
    "training, crops": Recipe(CROP_SIZE),
    "training, whole frames": Recipe(FRAME_SIZE),
    "retraining, whole frames": Recipe(FRAME_SIZE, retraining=True),
    "retraining": Recipe(crop_of(FRAME_SIZE), retraining=True, all_layers=False),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument(
        "--seconds", type=float, default=10.0, help="approximate seconds of a recipe in a round"
    )
    options = parser.parse_args()
    images, run = people(200), Run(threads=options.threads)
    speeds: dict[str, list[float]] = {name: [] for name in RECIPES}
    for _ in range(options.rounds):
        for name, recipe in RECIPES.items():
            speeds[name].append(
                options.batch
                * steps_per_second(recipe, images, options.batch, options.seconds, run)
            )
    for name, recipe in RECIPES.items():
        width, height = recipe.size
        found = speeds[name]
        print(
            f"{name:25} {width}x{height}  {np.median(found):6.0f} images/s ({min(found):.0f} to {max(found):.0f})"
        )
    ratios = np.divide(speeds["retraining"], speeds["retraining, whole frames"])
    print(
        f"retraining against whole frames: {np.median(ratios):.2f} times ({min(ratios):.2f} to {max(ratios):.2f})"
    )


def people(count: int) -> ImageSet:
    """Noise with a rectangle: the content of the images does not affect the speed."""
    rng = np.random.default_rng(0)
    box = (140.0, 60.0, 165.0, 120.0)
    truth = Truth(box, box, 1500, 1500, 40.0)
    return image_set(
        [(rng.integers(0, 255, (192, 320, 3), dtype=np.uint8), truth) for _ in range(count)]
    )


def steps_per_second(
    recipe: Recipe, images: ImageSet, count: int, seconds: float, run: Run
) -> float:
    """Steps per second after a warm-up, batches of `count` images and optimiser included."""

    def feed(iteration: int) -> Batch:
        times.append(time.perf_counter())
        return batch(images, np.arange(count) % len(images), recipe.size, (iteration,))

    times: list[float] = []
    _fit(recipe, WARM_UP + 2, feed, run)
    iterations = WARM_UP + max(2, round(seconds / (times[-1] - times[-2])))
    times.clear()
    _fit(recipe, iterations, feed, run)
    return (iterations - WARM_UP) / (time.perf_counter() - times[WARM_UP])


def _fit(recipe: Recipe, iterations: int, feed: Feed, run: Run) -> None:
    model = initial_model(0)
    model.stage4.requires_grad_(recipe.all_layers)
    schedule = Schedule(
        0, iterations, 1e-3, frozen_statistics=recipe.retraining, muon=not recipe.retraining
    )
    fit(model, Lesson(schedule, feed), run)


if __name__ == "__main__":
    main()
