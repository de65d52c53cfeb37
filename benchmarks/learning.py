"""Average precision from scratch, over training minutes and over the number of images, for several options.

`python benchmarks/learning.py --base-set data/base/base_set/truth.coco.json [--share 0.2] [--images 1250 5000 18000] [--size nano]
[--crops apart mosaic] [--relit ramp always never] [--seeds 0 1]`

Each training has `share` of the recipe's iterations, with a complete cosine schedule. Prints average precision on 900 images of new towns
and the CPU-seconds of the training without its evaluations. Writes learning.csv and learning.png.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure
from new_towns import rendered
from torch import Tensor

from pipeline.artefacts.dataset import ImageSet, read_dataset
from pipeline.config.composing import compose
from pipeline.detectors.evaluation import evaluate
from pipeline.detectors.yolo.data import usable
from pipeline.detectors.yolo.network import STRIDES, Yolo
from pipeline.detectors.yolo.recipe import CROP_SIZE, relit_share, train_from_scratch
from pipeline.detectors.yolo.training import Run, Validation
from pipeline.detectors.yolo.validation import detected, watching

NEW_IMAGES, NEW_SEED = 900, 99
RELIT: dict[str, Callable[[int], float]] = {
    "ramp": relit_share,
    "always": lambda _: 1.0,
    "never": lambda _: 0.0,
}


class Mosaic(Yolo):
    """Trains on four crops at a time, stitched into one frame. Boxes and losses are those of the crops."""

    def forward(self, x: Tensor) -> Tensor:
        n, channels, height, width = x.shape
        if not self.training or (width, height) != CROP_SIZE:
            return super().forward(x)
        stitched = (
            x.reshape(-1, 2, 2, *x.shape[1:])
            .permute(0, 3, 1, 4, 2, 5)
            .reshape(n // 4, channels, 2 * height, 2 * width)
        )
        frames = super().forward(stitched.contiguous(memory_format=torch.channels_last))
        rows = [(2 * height // stride, 2 * width // stride) for stride in STRIDES]
        levels = zip(torch.split(frames, [a * b for a, b in rows], 2), rows, strict=True)
        apart = [
            level.reshape(*level.shape[:2], 2, a // 2, 2, b // 2).permute(0, 2, 4, 1, 3, 5)
            for level, (a, b) in levels
        ]
        return torch.cat([level.reshape(n, level.shape[3], -1) for level in apart], 2)


@dataclass(frozen=True)
class Variant:
    """A training to compare. share: of the recipe's iterations, in (0, 1]; relit: a name in RELIT."""

    size: str
    crops: str
    relit: str
    seed: int
    share: float

    def __str__(self) -> str:
        return f"{self.size}, crops {self.crops}, relit {self.relit}, seed {self.seed}"

    def section(self) -> dict[str, Any]:
        """Section `training` of the config, shortened."""
        section: dict[str, Any] = compose(
            "base", [f"training.size={self.size}", f"training.seed={self.seed}"]
        ).training.model_dump()
        for phase in ("crop_iterations", "frame_iterations"):
            section[phase] = max(1, round(section[phase] * self.share))
        section["validate_every"] = max(
            1, round((section["crop_iterations"] + section["frame_iterations"]) / 12)
        )
        return section


@dataclass
class Clock:
    """Notes when iterations were done, without the evaluations: (iteration, seconds, CPU-seconds)."""

    stamps: list[tuple[float, float, float]] = field(default_factory=list)
    evaluating: tuple[float, float] = (0.0, 0.0)

    def now(self) -> tuple[float, float]:
        return time.monotonic() - self.evaluating[0], time.process_time() - self.evaluating[1]

    def note(self, done: int, _total: int = 0, _text: str = "") -> None:
        self.stamps.append((done, *self.now()))

    def watching(self, images: ImageSet, every: int, patience: int) -> Validation:
        watch = watching(images, every, patience)

        def ap50(model: Yolo) -> float:
            started = self.now()
            score = watch.ap50(model)
            seconds, cpu = (
                after - before for before, after in zip(started, self.now(), strict=True)
            )
            self.evaluating = self.evaluating[0] + seconds, self.evaluating[1] + cpu
            return score

        return replace(watch, ap50=ap50)

    def spent(self, iteration: int) -> tuple[float, float]:
        """Seconds and CPU-seconds from the start to an iteration."""
        done, *columns = np.array(self.stamps).T
        seconds, cpu = (float(np.interp(iteration, done, column)) - column[0] for column in columns)
        return seconds, cpu


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--base-set", type=Path, default=Path("data/base/base_set/truth.coco.json"))
    parser.add_argument(
        "--share",
        type=float,
        default=0.2,
        help="share of the recipe's iterations (default: %(default)s)",
    )
    parser.add_argument("--images", type=int, nargs="+", default=[1250, 2500, 5000, 10_000, 18_000])
    parser.add_argument("--size", nargs="+", default=["nano"], choices=["nano", "small"])
    parser.add_argument(
        "--crops",
        nargs="+",
        default=["apart"],
        choices=["apart", "mosaic"],
        help="how to show crops (default: apart)",
    )
    parser.add_argument(
        "--relit",
        nargs="+",
        default=["ramp"],
        choices=list(RELIT),
        help="when colours and light change (default: ramp)",
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("."))
    options = parser.parse_args()
    training, validation = (
        read_dataset(options.base_set.parent, "train"),
        read_dataset(options.base_set.parent, "val"),
    )
    with tempfile.TemporaryDirectory() as folder:
        unseen, *_ = rendered(Path(folder), NEW_IMAGES, NEW_SEED, options.threads)
    rows: list[dict[str, float | str]] = []
    for size, crops, relit, seed, count in product(
        options.size, options.crops, options.relit, options.seeds, options.images
    ):
        subset = training.take(
            np.linspace(0, len(training) - 1, min(count, len(training))).astype(np.int64)
        )
        variant = Variant(size, crops, relit, seed, options.share)
        rows += trained(variant, subset, validation, unseen, options.threads)
        last = rows[-1]
        result = f"AP50 {last['new_ap50']:.3f}, AP50-95 {last['new_ap50_95']:.3f} in new towns"
        print(
            f"{variant}, {len(subset)} images, {last['shown']} shown: {result} after {last['cpu_s']:.0f} CPU-s",
            flush=True,
        )
    table = pd.DataFrame(rows)
    table.to_csv(options.out / "learning.csv", index=False)
    draw(table).savefig(options.out / "learning.png", dpi=110)


def trained(
    variant: Variant, images: ImageSet, validation: ImageSet, unseen: ImageSet, threads: int
) -> list[dict[str, float | str]]:
    """One training; a row for each evaluation on the validation images. new_ap50 and new_ap50_95: of the final weights on `unseen`."""
    section, clock = variant.section(), Clock()
    with ExitStack() as changes:
        changes.enter_context(
            patch(
                "pipeline.detectors.yolo.recipe.Yolo",
                {"apart": Yolo, "mosaic": Mosaic}[variant.crops],
            )
        )
        changes.enter_context(
            patch("pipeline.detectors.yolo.recipe.relit_share", RELIT[variant.relit])
        )
        changes.enter_context(patch("pipeline.detectors.yolo.recipe.watching", clock.watching))
        clock.note(0)
        fitted = train_from_scratch(
            images, usable(images), validation, section, Run(threads=threads, progress=clock.note)
        )
    new = evaluate(detected(fitted.model, unseen), unseen, threshold=0.5)
    rows: list[dict[str, float | str]] = []
    for look in fitted.curve:
        seconds, cpu = clock.spent(look.iteration)
        spent = {
            "minutes": seconds / 60,
            "cpu_s": cpu,
            "shown": look.iteration * section["batch_size"],
        }
        score = {"ap50": look.ap50, "new_ap50": new["ap50"], "new_ap50_95": new["ap50_95"]}
        rows.append(
            {
                "training": str(variant),
                "images": len(images),
                "iteration": look.iteration,
                **spent,
                **score,
            }
        )
    return rows


def draw(table: pd.DataFrame) -> Figure:
    """Left: the curve of each training. Right: its last value over the number of images."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for (training, count), rows in table.groupby(["training", "images"]):
        left.plot(rows["minutes"], rows["ap50"], label=f"{training}, {count} images")
    for training, rows in table.groupby("training"):
        last = rows.groupby("images")["ap50"].last()
        right.plot(last.index, last, marker="o", label=training)
    left.set(xlabel="training minutes", ylabel="AP50, 500 validation images")
    right.set(xlabel="images", xscale="log")
    left.legend()
    right.legend()
    return figure


if __name__ == "__main__":
    main()
