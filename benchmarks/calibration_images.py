"""How many images a calibration needs: `python benchmarks/calibration_images.py --base-set truth.coco.json [FOLDER ...]`.

Fits the calibration of each version (FOLDER with weights.safetensors and model.json) on random subsets of the validation images. Prints
how far such a fit moves the confidence in use, which is fitted on all images. Two versions can differ by as much through the choice of
images alone.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.artefacts.dataset import ImageSet, read_dataset
from pipeline.artefacts.model_card import read_card
from pipeline.config.composing import compose
from pipeline.core.reliability import Calibration, platt
from pipeline.detectors.evaluation import judged_scores
from pipeline.detectors.yolo.export import export_onnx
from pipeline.detectors.yolo.weights import load_weights
from pipeline.learning.versions import detect_all

PARTS = 200
Judged = tuple[NDArray[np.float64], NDArray[np.bool_]]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "versions", type=Path, nargs="*", default=[Path("models/uniform")], metavar="FOLDER"
    )
    parser.add_argument(
        "--base-set", type=Path, required=True, help="truth.coco.json of a rendered base set"
    )
    parser.add_argument(
        "--images",
        type=int,
        nargs="+",
        default=[450, 900, 1800, 3600],
        help="images in a subset (default: %(default)s)",
    )
    options = parser.parse_args()
    validation, used = (
        read_dataset(options.base_set.parent, "val"),
        float(compose("default", []).detector["threshold"]),
    )
    print(f"{'version':14}{'images':>8}{'their confidence':>18}{'standard deviation':>20}")
    for folder in options.versions:
        judged = judged_by_image(folder, validation)
        whole = platt(*joined(judged))
        raw = 1 / (1 + np.exp(-(np.log(used / (1 - used)) - whole.offset) / whole.slope))
        rng = np.random.default_rng(0)
        for count in (count for count in options.images if count < len(judged)):
            parts = [
                fitted([judged[i] for i in rng.choice(len(judged), count, replace=False)])
                for _ in range(PARTS)
            ]
            found = np.array([float(part.apply(raw)) for part in parts])
            print(
                f"{read_card(folder / 'model.json').version:14}{count:8}{found.mean():18.3f}{found.std():20.3f}",
                flush=True,
            )


def judged_by_image(folder: Path, images: ImageSet) -> list[Judged]:
    """Scores as trained and whether they are right, image by image."""
    with tempfile.TemporaryDirectory() as scratch:
        onnx = Path(scratch) / "plain.onnx"
        export_onnx(onnx, load_weights(folder / "weights.safetensors"), images.size)
        found = detect_all(onnx, images, lambda *_: None)
    return [judged_scores([found[i]], images.take(np.array([i]))) for i in range(len(images))]


def joined(judged: list[Judged]) -> Judged:
    return np.concatenate([scores for scores, _ in judged]), np.concatenate(
        [right for _, right in judged]
    )


def fitted(judged: list[Judged]) -> Calibration:
    return platt(*joined(judged))


if __name__ == "__main__":
    main()
