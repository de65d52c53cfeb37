"""Do detectors gain from full coverage? The front-car study for several draws of its random points.

python benchmarks/front_car.py [--seeds 5] [key=value ...]
"""

from __future__ import annotations

import argparse
import tempfile
from contextlib import chdir
from pathlib import Path

import numpy as np

from pipeline.artefacts.front_car_results import Evaluation
from pipeline.artefacts.results import read
from pipeline.config.composing import compose
from pipeline.contract import order_of, perform
from pipeline.core.statistics import mean_interval


def study(seed: int, overrides: list[str]) -> Evaluation:
    """Run the study with a seed in a folder of its own."""
    shipped = Path("models/uniform").resolve()
    config = compose("front_car", [f"base.weights={shipped}", f"front_car.seed={seed}", *overrides])
    jobs = [("front_car_points", ""), *(("front_car_snapshots", version) for version in ("existing", "covered", "test"))]
    jobs += [("front_car_train", version) for version in ("existing", "covered")] + [("front_car_evaluate", "")]
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for step, version in jobs:
            perform(order_of(step, config, {"version": version} if version else {}, stamp="benchmark", threads=2), config)
        return read(Path("data/front_car/evaluation.json"), Evaluation)


def main() -> None:
    """Run the studies; print a row each and the mean difference."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="of the configuration, such as front_car.images=2000")
    options = parser.parse_args()
    gains = []
    for seed in range(options.seeds):
        result = study(seed, options.overrides)
        shares = [float(np.mean([right for point in d.points for right in point.right])) for d in result.detectors]
        gains.append(shares[1] - shares[0])
        texts = [
            f"{d.learnt_points} points right {share:.3f}, AP50 {d.metrics['ap50']:.3f}"
            for d, share in zip(result.detectors, shares, strict=True)
        ]
        print(f"seed {seed}: {'; '.join(texts)}; p = {result.p_value:.2g}", flush=True)
    low, high = mean_interval(gains)
    print(f"gain in the share of right snapshots: {np.mean(gains):+.3f} (95 % interval over seeds {low:+.3f} to {high:+.3f})")


if __name__ == "__main__":
    main()
