"""Does full coverage make a better detector? The front-car study for several draws of its random points.

python benchmarks/front_car.py [--seeds 5] [key=value ...]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from pipeline.artefacts.front_car_results import Evaluation
from pipeline.artefacts.results import read
from pipeline.config.composing import compose
from pipeline.core.statistics import mean_interval
from pipeline.progress import Progress
from pipeline.steps import front_car_evaluate, front_car_points, front_car_snapshots, front_car_train


def study(seed: int, overrides: list[str], root: Path) -> Evaluation:
    """Run the study with a seed in a folder."""
    config = compose("front_car", [f"front_car.seed={seed}", *overrides])
    points, cards = root / "points.json", []

    def step(name: str) -> Progress:
        return Progress(f"seed {seed}, {name}", None)

    with step("points") as progress:
        front_car_points.run(config, out=points, progress=progress)
    for version in ("existing", "covered", "test"):
        truth = root / version / "truth.coco.json"
        with step(f"snapshots of {version}") as progress:
            front_car_snapshots.run(config, points=points, version=version, out=truth, threads=2, progress=progress)
        if version == "test":
            continue
        cards.append(root / "detectors" / version / "model.json")
        with step(f"training on {version}") as progress:
            front_car_train.run(config, version=version, snapshots=truth, out=cards[-1], threads=2, progress=progress)
    out = root / "evaluation.json"
    with step("evaluation") as progress:
        front_car_evaluate.run(config, points=points, test=root / "test" / "truth.coco.json", models=cards, out=out, progress=progress)
    return read(out, Evaluation)


def main() -> None:
    """Run the studies; print one line per study and the mean difference."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="configuration overrides, such as front_car.images=2000")
    options = parser.parse_args()
    gains = []
    for seed in range(options.seeds):
        with tempfile.TemporaryDirectory() as folder:
            result = study(seed, options.overrides, Path(folder))
        shares = [float(np.mean([right for point in d.points for right in point.right])) for d in result.detectors]
        gains.append(shares[1] - shares[0])
        texts = [
            f"{d.learnt_points} points right {share:.3f}, AP50 {d.metrics['ap50']:.3f}"
            for d, share in zip(result.detectors, shares, strict=True)
        ]
        print(f"seed {seed}: {'; '.join(texts)}; p = {result.p_value:.2g}", flush=True)
    low, high = mean_interval(gains)
    print(f"difference in the share of right snapshots: {np.mean(gains):+.3f} (95 % interval over seeds {low:+.3f} to {high:+.3f})")


if __name__ == "__main__":
    main()
