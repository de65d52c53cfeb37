"""Average precision against training minutes and against the number of images, from scratch, and what options change.

`python benchmarks/learning.py --base-set data/base/base_set/truth.coco.json [--share 0.2] [--images 1250 5000 18000] [--size nano]`

Each training has `share` of the recipe's iterations, its whole cosine included. Writes learning.csv and learning.png beside each other.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.artefacts.dataset import ImageSet, read_dataset
from pipeline.config import compose
from pipeline.detectors.yolo.data import usable
from pipeline.detectors.yolo.recipe import train_from_scratch


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base-set", type=Path, default=Path("data/base/base_set/truth.coco.json"))
    parser.add_argument("--share", type=float, default=0.2, help="of the recipe's iterations (default: %(default)s)")
    parser.add_argument("--images", type=int, nargs="+", default=[1250, 2500, 5000, 10_000, 18_000])
    parser.add_argument("--size", nargs="+", default=["nano"], choices=["nano", "small"])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("."))
    options = parser.parse_args()
    training, validation = read_dataset(options.base_set.parent, "train"), read_dataset(options.base_set.parent, "val")
    rows = []
    for size in options.size:
        for count in options.images:
            subset = training.take(np.linspace(0, len(training) - 1, min(count, len(training))).astype(np.int64))
            rows += trained(subset, validation, size, options.share, options.threads)
            print(f"{size}, {len(subset)} images: AP50 {rows[-1]['ap50']:.3f} after {rows[-1]['minutes']:.1f} minutes", flush=True)
    table = pd.DataFrame(rows)
    table.to_csv(options.out / "learning.csv", index=False)
    draw(table).savefig(options.out / "learning.png", dpi=110)


def trained(images: ImageSet, validation: ImageSet, size: str, share: float, threads: int) -> list[dict[str, float | str]]:
    """One training; a row for each look at the validation images."""
    section = compose("base", [f"training.size={size}"]).training.model_dump()
    for phase in ("crop_iterations", "frame_iterations"):
        section[phase] = max(1, round(section[phase] * share))
    section["validate_every"] = max(1, round((section["crop_iterations"] + section["frame_iterations"]) / 12))
    stamps: list[tuple[int, float]] = []
    started = time.monotonic()
    fitted = train_from_scratch(
        images,
        usable(images),
        validation,
        section,
        checkpoint=None,
        threads=threads,
        progress=lambda done, _total, _text: stamps.append((done, time.monotonic() - started)),
    )
    done, seconds = (np.array(column) for column in zip(*stamps, strict=True))
    minutes = [float(np.interp(look.iteration, done, seconds)) / 60 for look in fitted.curve]
    return [
        {"size": size, "images": len(images), "iteration": look.iteration, "minutes": spent, "ap50": look.ap50}
        for look, spent in zip(fitted.curve, minutes, strict=True)
    ]


def draw(table: pd.DataFrame) -> Figure:
    """Left: every training's curve. Right: its end against the number of images."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for (size, count), rows in table.groupby(["size", "images"]):
        left.plot(rows["minutes"], rows["ap50"], label=f"{size}, {count} images")
    for size, rows in table.groupby("size"):
        last = rows.groupby("images")["ap50"].last()
        right.plot(last.index, last, marker="o", label=size)
    left.set(xlabel="training minutes", ylabel="AP50, 500 validation images")
    right.set(xlabel="images", xscale="log")
    left.legend()
    right.legend()
    return figure


if __name__ == "__main__":
    main()
