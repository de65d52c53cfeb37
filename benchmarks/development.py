"""Compare model versions without touching the held-out scenarios.

`python benchmarks/development.py FOLDER FOLDER... [--tests 60] [--scenario F1 F2 F3]`

Runs the search scenarios in another suburban town with other people, with the same pair-wise tests for every version, to choose a recipe
before the held-out scenarios judge it. FOLDER holds a version's model.onnx, or its weights.safetensors and model.json; the others are
compared with the first.
"""

from __future__ import annotations

import argparse
import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from hydra.utils import instantiate

from pipeline.config.composing import compose
from pipeline.config.schema import Config
from pipeline.core import kpi
from pipeline.core.identity import CampaignId
from pipeline.core.statistics import mcnemar
from pipeline.detectors.yolo.export import onnx_of
from pipeline.execution import journal
from pipeline.execution.campaign import sampler_seed
from pipeline.execution.workers import Execution, Setup, Workers
from pipeline.progress import Progress

TOWN = {"style": "suburban", "seed": 987_654}
PEOPLE = 3
"""A population that is neither searched nor held out."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("version", nargs="+", type=Path)
    parser.add_argument("--tests", type=int, default=60, help="tests per scenario")
    parser.add_argument("--scenario", nargs="+", default=["F1", "F2", "F3"])
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    config = compose("retraining", [])
    failed: dict[Path, list[bool]] = {version: [] for version in options.version}
    with tempfile.TemporaryDirectory() as folder, Progress("development") as progress:
        for i, version in enumerate(options.version):
            own = Path(folder) / str(i)
            own.mkdir()
            model = onnx_of(version, own)
            for scenario in options.scenario:
                failed[version] += _failures(
                    config, scenario, model, options.tests, options.workers, own
                )
                done = i * len(options.scenario) * options.tests + len(failed[version])
                progress(
                    done,
                    len(options.version) * len(options.scenario) * options.tests,
                    f"{version}: {sum(failed[version])} failures",
                )
    print(
        f"{'failures':>8}  {'by scenario':<{4 * len(options.scenario)}}{'fixes':>7}{'regressions':>13}{'McNemar p':>11}  version"
    )
    first = failed[options.version[0]]
    for version, found in failed.items():
        paired = mcnemar(first, found)
        parts = "".join(
            f"{int(np.sum(part)):>4}" for part in np.split(np.array(found), len(options.scenario))
        )
        print(
            f"{sum(found):>8}  {parts}{paired.fixes:>7}{paired.regressions:>13}{paired.p_value:>11.2g}  {version}"
        )


def _failures(
    config: Config, scenario: str, model: Path, tests: int, workers: int, folder: Path
) -> list[bool]:
    """Whether each test fails, in the order of the pair-wise sequence."""
    described = config.scenarios[scenario]
    moved = described.model_copy(
        update={"town": described.town.model_copy(update=TOWN), "people": PEOPLE}
    )
    space = moved.logical_space()
    seed = sampler_seed(CampaignId(scenario, "pairwise", "base", 3), frozen=True)
    sampler = instantiate(config.samplers["pairwise"], _partial_=True, _convert_="all")(
        space=space, seed=seed
    )
    points = np.concatenate(
        [_asked(sampler) for _ in range(-(-tests // config.samplers["pairwise"]["batch_size"]))]
    )[:tests]
    log = journal.Journal(folder / scenario, scenario, Progress(scenario))
    with closing(
        Workers(
            workers,
            Setup(config.simulator, moved, config.detector, model, config.car, config.limits),
        )
    ) as pool:
        for _ in pool.execute(
            [Execution(i, log.path(i), space.decode(point)) for i, point in enumerate(points)]
        ):
            pass
    outcomes = [log.read(i) for i in range(tests)]
    if errors := [outcome.reason for outcome in outcomes if outcome.is_error]:
        raise SystemExit(f"{scenario}: {len(errors)} tests ended in an error: {errors[0]}")
    return [
        kpi.evaluate(outcome.signals, config.campaign.failure_threshold_s).failure
        for outcome in outcomes
    ]


def _asked(sampler: Any) -> Any:
    points = sampler.ask()
    sampler.tell(points, np.ones(len(points)))
    return points


if __name__ == "__main__":
    main()
