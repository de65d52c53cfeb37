"""Model versions in towns that none of them has seen: `python benchmarks/new_towns.py FOLDER ... [--images 2000] [--seed 99]`.

The validation images of a study show the same towns as the training images of its retrained versions, so metrics and calibration may
hold only there. FOLDER holds weights.safetensors and model.json. Prints the metrics of each version in new towns (in brackets on the
validation images, from its card), and the mean confidence of its detections at or above the threshold in use.
"""

from __future__ import annotations

import argparse
import tempfile
from contextlib import chdir
from pathlib import Path

import numpy as np

from pipeline.artefacts.dataset import ImageSet, joined, read_dataset, read_towns
from pipeline.artefacts.model_card import read_card
from pipeline.config.composing import compose
from pipeline.contract import order_of, perform
from pipeline.core.reliability import Calibration
from pipeline.detectors.evaluation import evaluate, judged_scores
from pipeline.detectors.yolo.export import onnx_of
from pipeline.learning.versions import detect_all


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("versions", type=Path, nargs="*", default=[Path("models/base")], metavar="FOLDER")
    parser.add_argument("--images", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=99, help="seed of the towns (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        images, towns = rendered(Path(folder), options.images, options.seed, options.workers)
    threshold = float(compose("default", []).detector["threshold"])
    print(f"{len(images)} images of {len(towns)} new towns; in brackets: validation images, from the version's card")
    print(f"{'version':14}{'AP50':>15}{'AP50-95':>15}{'recall':>15}{'precision':>15}{'mean':>7}")
    for version in options.versions:
        card = read_card(version / "model.json")
        if known := towns & set(card.towns):
            raise SystemExit(f"{version} was trained on {len(known)} of these towns; choose another --seed")
        with tempfile.TemporaryDirectory() as folder:
            found = detect_all(onnx_of(version, Path(folder)), images, Calibration(**card.calibration))
        new, scores = evaluate(found, images, threshold), judged_scores(found, images)[0]
        cells = (f"{new[name]:.3f} ({card.metrics[name]:.3f})" for name in ("ap50", "ap50_95", "recall", "precision"))
        print(f"{card.version:14}{''.join(f'{cell:>15}' for cell in cells)}{np.mean(scores[scores >= threshold]):7.3f}", flush=True)


def rendered(folder: Path, count: int, seed: int, workers: int) -> tuple[ImageSet, set[str]]:
    """The images and the fingerprints of their towns."""
    config = compose("base", [f"base_set.images={count}", f"base_set.seed={seed}"])
    with chdir(folder):
        perform(order_of("render_base", config, {}, stamp="benchmark", threads=workers), config)
    root = folder / "data/base/base_set"
    return joined(read_dataset(root, "train"), read_dataset(root, "val")), set(read_towns(root))


if __name__ == "__main__":
    main()
