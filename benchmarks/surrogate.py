"""How a strategy's settings distribute its tests, without rendering: on a model fitted to the tests of an executed study.

The model (extra trees on the space's variables, its attributes and the scenario) gives each point's failure probability, and its KPI if it
does not fail; a draw that depends on the point alone decides. It shows where tests go but proves nothing about a detector. Prints tests and
failures by group of pedestrians.

python -m pipeline compose study=retraining && ./run      # at least its campaigns
python benchmarks/surrogate.py data/retraining [--kinds 1 6] [--seeds 2]
"""

from __future__ import annotations

import argparse
import hashlib
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
from hydra.utils import instantiate
from numpy.typing import NDArray
from sklearn.ensemble import ExtraTreesClassifier, ExtraTreesRegressor
from tqdm import tqdm
from who_fails import GROUPS, groups

from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.tables import read_tests
from pipeline.config.composing import compose
from pipeline.config.schema import Config, Target
from pipeline.core.identity import CampaignId
from pipeline.core.space import Floats
from pipeline.execution.campaign import sampler_seed


class Surrogate:
    """Stands in for the simulator and the detector of all scenarios of a study."""

    def __init__(self, config: Config, tests: pd.DataFrame) -> None:
        self._names, self._space = config.search, config.space(config.search[0])
        points, scenarios = encode_tests(tests, self._space), tests["scenario"].map(self._names.index).to_numpy(np.int64)
        kpi, failed = tests["adj_ttc_s"].to_numpy(float), tests["failure"].to_numpy(bool)
        features, settings = self._features(points, scenarios), {"min_samples_leaf": 3, "max_features": 0.4, "random_state": 0}
        self._fails = ExtraTreesClassifier(400, **settings).fit(features, failed)
        self._passes = ExtraTreesRegressor(200, **settings).fit(features[~failed], kpi[~failed])

    def kpi(self, points: Floats, scenario: int) -> Floats:
        """(n,) seconds; 0 for a failure."""
        features = self._features(points, np.full(len(points), scenario))
        chance = [int.from_bytes(hashlib.sha256(point.tobytes() + bytes([scenario])).digest()[:4], "little") / 2**32 for point in points]
        return np.where(np.array(chance) < self._fails.predict_proba(features)[:, 1], 0.0, self._passes.predict(features))

    def _features(self, points: Floats, scenarios: NDArray[np.int64]) -> Floats:
        columns = [(scenarios[:, None] == np.arange(len(self._names))[None]).astype(float)]
        for j, variable in enumerate(self._space.variables):
            if variable.kind != "categorical":
                columns.append(points[:, [j]])
                continue
            category = points[:, j].astype(int)
            columns.append((category[:, None] == np.arange(variable.size)[None]).astype(float))
            columns += [np.array(numbers)[category][:, None] for _, numbers in variable.attributes]
        return np.column_stack(columns)


def search(config: Config, world: Surrogate, strategy: Target, transfer: bool, seeds: Iterable[int]) -> tuple[Counter[str], Counter[str]]:
    """Tests and failures by group, of campaigns on every scenario; with `transfer` each learns from those before it."""
    space, tests, failures = config.space(config.search[0]), Counter[str](), Counter[str]()
    for seed in seeds:
        earlier: list[tuple[Floats, Floats]] = []
        for scenario, searched in enumerate(config.search):
            history = {"earlier": earlier} if transfer else {}
            own = sampler_seed(CampaignId(searched, "neural", "base", seed))
            sampler = instantiate(strategy, _partial_=True, _convert_="all")(space=space, seed=own, **history)
            executed = []
            for _ in range(-(-config.campaign.tests // sampler.batch_size)):
                points = sampler.ask()
                kpi = world.kpi(points, scenario)
                sampler.tell(points, kpi)
                executed.append((points, kpi))
                shown = groups(space, points)
                tests.update(shown)
                failures.update(name for name, value in zip(shown, kpi, strict=True) if value <= config.campaign.failure_threshold_s)
            points, kpi = (np.concatenate(parts) for parts in zip(*executed, strict=True))
            earlier.append((points, kpi))
    return tests, failures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", nargs="+", type=Path, help="data folders of executed studies of the base detector")
    parser.add_argument("--kinds", nargs="+", type=int, default=[1, 6], help="`kinds` of the neural strategy")
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    config = compose("retraining", [])
    paths = [path for study in options.study for path in sorted(study.glob("campaigns/*/*/base/*/tests.parquet"))]
    if not paths:
        raise SystemExit(
            f"expected campaigns/*/*/base/*/tests.parquet in {', '.join(map(str, options.study))}, found none; run the study first"
        )
    executed = pd.concat([read_tests(path) for path in paths])
    executed = executed[(executed["status"] == "ok") & executed["scenario"].isin(config.search)]
    world = Surrogate(config, executed)
    print(f"fitted to {len(executed)} tests, {executed['failure'].sum()} failures. Tests and failures per seed:")
    print(f"{'strategy':<30}" + "".join(f"{name:>30}" for name in (*GROUPS, "all")))
    settings = {"random": (config.samplers["random"], False)}
    for kinds in options.kinds:
        for name, transfer in (("alone", False), ("transfer", True)):
            settings[f"neural, {kinds} kinds, {name}"] = ({**config.samplers["neural"], "kinds": kinds}, transfer)
    for name, (strategy, transfer) in settings.items():
        tests, failures = search(config, world, strategy, transfer, tqdm(range(options.seeds), desc=name, unit="seed"))
        cells = [f"{tests[name] / options.seeds:.0f}, {failures[name] / options.seeds:.0f} fail" for name in GROUPS]
        cells.append(f"{tests.total() / options.seeds:.0f}, {failures.total() / options.seeds:.0f} fail")
        print(f"{name:<30}" + "".join(f"{cell:>30}" for cell in cells))


if __name__ == "__main__":
    main()
