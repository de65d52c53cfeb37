"""Average precision from scratch, over training minutes and over the number of images, for several options.

`python benchmarks/learning.py --base-set data/base/base_set/truth.coco.json [--share 0.2] [--images 1250 5000 18000] [--size nano]
[--crops apart mosaic]`

Each training has `share` of the recipe's iterations, with a complete cosine schedule. Writes learning.csv and learning.png.
"""

from __future__ import annotations

import argparse
import time
from itertools import product
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure
from torch import Tensor

from pipeline.artefacts.dataset import ImageSet, read_dataset
from pipeline.config.composing import compose
from pipeline.detectors.yolo.data import usable
from pipeline.detectors.yolo.network import STRIDES, Yolo
from pipeline.detectors.yolo.recipe import CROP_SIZE, train_from_scratch
from pipeline.detectors.yolo.training import Run


class Mosaic(Yolo):
    """Trains on four crops at a time, stitched into one frame. Boxes and losses are those of the crops."""

    def forward(self, x: Tensor) -> Tensor:
        n, channels, height, width = x.shape
        if not self.training or (width, height) != CROP_SIZE:
            return super().forward(x)
        stitched = x.reshape(-1, 2, 2, *x.shape[1:]).permute(0, 3, 1, 4, 2, 5).reshape(n // 4, channels, 2 * height, 2 * width)
        frames = super().forward(stitched.contiguous(memory_format=torch.channels_last))
        rows = [(2 * height // stride, 2 * width // stride) for stride in STRIDES]
        levels = zip(torch.split(frames, [a * b for a, b in rows], 2), rows, strict=True)
        apart = [level.reshape(*level.shape[:2], 2, a // 2, 2, b // 2).permute(0, 2, 4, 1, 3, 5) for level, (a, b) in levels]
        return torch.cat([level.reshape(n, level.shape[3], -1) for level in apart], 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base-set", type=Path, default=Path("data/base/base_set/truth.coco.json"))
    parser.add_argument("--share", type=float, default=0.2, help="share of the recipe's iterations (default: %(default)s)")
    parser.add_argument("--images", type=int, nargs="+", default=[1250, 2500, 5000, 10_000, 18_000])
    parser.add_argument("--size", nargs="+", default=["nano"], choices=["nano", "small"])
    parser.add_argument("--crops", nargs="+", default=["apart"], choices=["apart", "mosaic"], help="how to show crops (default: apart)")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("."))
    options = parser.parse_args()
    training, validation = read_dataset(options.base_set.parent, "train"), read_dataset(options.base_set.parent, "val")
    rows: list[dict[str, float | str]] = []
    for size, crops, count in product(options.size, options.crops, options.images):
        subset = training.take(np.linspace(0, len(training) - 1, min(count, len(training))).astype(np.int64))
        with patch("pipeline.detectors.yolo.recipe.Yolo", {"apart": Yolo, "mosaic": Mosaic}[crops]):
            looks = trained(subset, validation, size, options.share, options.threads)
        rows += [{**look, "training": f"{size}, crops {crops}"} for look in looks]
        last = rows[-1]
        print(f"{last['training']}, {len(subset)} images: AP50 {last['ap50']:.3f} after {last['minutes']:.1f} minutes", flush=True)
    table = pd.DataFrame(rows)
    table.to_csv(options.out / "learning.csv", index=False)
    draw(table).savefig(options.out / "learning.png", dpi=110)


def trained(images: ImageSet, validation: ImageSet, size: str, share: float, threads: int) -> list[dict[str, float]]:
    """One training; a row for each evaluation on the validation images."""
    section = compose("base", [f"training.size={size}"]).training.model_dump()
    for phase in ("crop_iterations", "frame_iterations"):
        section[phase] = max(1, round(section[phase] * share))
    section["validate_every"] = max(1, round((section["crop_iterations"] + section["frame_iterations"]) / 12))
    stamps: list[tuple[int, float]] = []
    started = time.monotonic()
    run = Run(threads=threads, progress=lambda done, _total, _text: stamps.append((done, time.monotonic() - started)))
    fitted = train_from_scratch(images, usable(images), validation, section, run)
    done, seconds = (np.array(column) for column in zip(*stamps, strict=True))
    minutes = [float(np.interp(look.iteration, done, seconds)) / 60 for look in fitted.curve]
    return [
        {"images": len(images), "iteration": look.iteration, "minutes": spent, "ap50": look.ap50}
        for look, spent in zip(fitted.curve, minutes, strict=True)
    ]


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
