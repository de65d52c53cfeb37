"""Model versions on towns and people that none has seen: `python benchmarks/new_towns.py FOLDER ... [--images 2000] [--seed 99]`.

The validation images of a study show the same towns as the training images of its retrained versions, so metrics and calibration may
hold only there. FOLDER holds weights.safetensors and model.json. All people and poses are equally frequent. Prints the metrics of each
version in new towns (in brackets on the validation images, from its card), and the mean confidence of its detections at or above the
threshold in use; then the average precision on children and crouching people, and on the others.
"""

from __future__ import annotations

import argparse
import tempfile
from contextlib import chdir
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.artefacts.dataset import ImageSet, joined, read_dataset, read_worlds
from pipeline.artefacts.files import read_json
from pipeline.artefacts.model_card import read_card
from pipeline.config.composing import compose
from pipeline.contract import order_of, perform
from pipeline.core.reliability import Calibration
from pipeline.core.worlds import Worlds
from pipeline.detectors.evaluation import evaluate, judged_scores
from pipeline.detectors.yolo.export import onnx_of
from pipeline.learning.versions import detect_all
from pipeline.scenarios.people import person


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "versions",
        type=Path,
        nargs="*",
        default=[Path("models/uniform"), Path("models/long_tailed")],
        metavar="FOLDER",
    )
    parser.add_argument("--images", type=int, default=2000)
    parser.add_argument(
        "--seed", type=int, default=99, help="seed of the towns (default: %(default)s)"
    )
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        images, worlds, rare = rendered(Path(folder), options.images, options.seed, options.workers)
    groups = {"children or crouching": np.flatnonzero(rare), "others": np.flatnonzero(~rare)}
    threshold = float(compose("default", []).detector["threshold"])
    shown = f"{len(images)} images of {len(worlds.towns)} new towns with {len(worlds.people)} new populations"
    print(f"{shown}; in brackets: validation images, from the version's card")
    print(f"{'version':14}{'AP50':>15}{'AP50-95':>15}{'recall':>15}{'precision':>15}{'mean':>7}")
    for version in options.versions:
        card = read_card(version / "model.json")
        if known := worlds & card.worlds:
            raise SystemExit(
                f"{version} was trained on {len(list(known))} of these towns and populations; choose another --seed"
            )
        with tempfile.TemporaryDirectory() as folder:
            found = detect_all(
                onnx_of(version, Path(folder)),
                images,
                lambda *_: None,
                Calibration(**card.calibration),
            )
        new, scores = evaluate(found, images, threshold), judged_scores(found, images)[0]
        cells = (
            f"{new[name]:.3f} ({card.metrics[name]:.3f})"
            for name in ("ap50", "ap50_95", "recall", "precision")
        )
        print(
            f"{version.name:14}{''.join(f'{cell:>15}' for cell in cells)}{np.mean(scores[scores >= threshold]):7.3f}",
            flush=True,
        )
        for name, indices in groups.items():
            part = evaluate([found[index] for index in indices], images.take(indices), threshold)
            print(
                f"  {name}, {len(indices)} images: AP50 {part['ap50']:.3f}, AP50-95 {part['ap50_95']:.3f}",
                flush=True,
            )


def rendered(
    folder: Path, count: int, seed: int, workers: int
) -> tuple[ImageSet, Worlds, NDArray[np.bool_]]:
    """The images, their towns and people, and whether each shows somebody who is a child or crouching."""
    config = compose("base", [f"base_set.images={count}", f"base_set.seed={seed}"])
    with chdir(folder):
        perform(order_of("render_base", config, {}, stamp="benchmark", threads=workers), config)
    root = folder / "data/base/base_set"
    listed = read_json(root / "truth.coco.json")["images"]
    # In the order in which `read_dataset` gives the images of each split.
    shown = [
        image["attributes"]
        for split in ("train", "val")
        for image in sorted(
            (one for one in listed if one["split"] == split), key=lambda one: str(one["file_name"])
        )
    ]
    rare = [person(one["blueprint"]).child or one["animation"] == "crouching" for one in shown]
    return (
        joined(read_dataset(root, "train"), read_dataset(root, "val")),
        read_worlds(root),
        np.array(rare),
    )


if __name__ == "__main__":
    main()
