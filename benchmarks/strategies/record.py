"""Records rendered campaigns, from which the emulators and the tables of the thesis' grid are made.

    python benchmarks/strategies/record.py --study default --scenario F1 [F5 ...] [--threads 2]
    python benchmarks/strategies/record.py --study thesis

Tests the shipped uniform base with a study's car, camera and brake law, and writes benchmarks/strategies/data/STUDY/F1-random.csv.gz and so
on. `default`: for the emulators, 4,000 tests a scenario, half of them random. `thesis`: the grid of chapter 6, each strategy with 1,000
tests. A campaign whose table is there is not executed again. Finished tests of the others stay in the folder `--journal`, so the same
command resumes a killed run, unless the program has changed.
"""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import recorded

from pipeline.artefacts.files import sha256, write_json
from pipeline.config.composing import compose, functional_scenario
from pipeline.config.schema import Config
from pipeline.core.identity import CampaignId
from pipeline.core.names import nearest
from pipeline.core.space import Floats, Space
from pipeline.detectors.yolo.export import onnx_of
from pipeline.errors import InputError
from pipeline.execution.campaign import CampaignPlan, Executed, search
from pipeline.execution.journal import Journal
from pipeline.execution.workers import Setup, Workers
from pipeline.progress import Progress
from pipeline.protocols import Sampler

BASE = Path("models/uniform")
DIGITS = 5
"""Significant digits of a recorded KPI."""
DENSE = {"random": 2000, "forest": 700, "network": 700, "evolutionary": 600}
"""Tests of each strategy for the emulators. Three strategies search, so that an emulator knows where each of them goes."""


@dataclass
class OnGrid:
    """A strategy whose points are rounded before they are executed, so that the table loses nothing."""

    sampler: Sampler
    space: Space

    def ask(self) -> Floats:
        return recorded.on_grid(self.space, self.sampler.ask())

    def tell(self, points: Floats, kpi: Floats) -> None:
        self.sampler.tell(points, kpi)


def main() -> None:
    """Execute the campaigns that have no table yet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--study", required=True, choices=["default", "thesis"], help="whose settings hold"
    )
    parser.add_argument("--scenario", nargs="+", help="default: those that the study searches")
    parser.add_argument("--strategy", nargs="+", help="default: all of the study")
    parser.add_argument("--tests", type=int, help="of each campaign")
    parser.add_argument("--threads", type=int, default=2, help="processes that execute tests")
    parser.add_argument("--journal", type=Path, default=Path("data/strategies/recording"))
    parser.add_argument("--out", type=Path, default=recorded.DATA)
    options = parser.parse_args()
    try:
        record(options)
    except InputError as error:
        parser.error(str(error))


def record(options: argparse.Namespace) -> None:
    """Execute what is missing; InputError for an unknown strategy and where tables were recorded with other settings."""
    config = compose(options.study, [])
    budgets = (
        DENSE
        if options.study == "default"
        else dict.fromkeys(config.strategies, config.campaign.tests)
    )
    for name in options.strategy or ():
        if name not in budgets:
            raise InputError(f"there is no strategy '{name}'{nearest(name, list(budgets))}")
    out, journal = options.out / options.study, options.journal / options.study
    for scenario in options.scenario or config.search:
        for strategy in options.strategy or budgets:
            path = recorded.path_of(scenario, strategy, out)
            if path.exists():
                continue
            _agree(out, config, strategy)
            # Random tests need no results, so in one batch no process waits for another.
            tests = options.tests or budgets[strategy]
            settings = {
                **config.samplers[strategy],
                **({"batch_size": tests} if strategy == "random" else {}),
            }
            plan = campaign_plan(
                config, journal, CampaignId(scenario, strategy, "base", 0), settings, tests
            )
            record_campaign(plan, plan.sampler(), path, journal / path.stem, options.threads)


def _agree(out: Path, config: Config, strategy: str) -> None:
    """Keep what the campaigns of a folder are executed with in its settings.json; InputError if its tables had other settings."""
    path = out / "settings.json"
    now: dict[str, Any] = {
        "weights_sha256": sha256(BASE / "weights.safetensors"),
        "detector": dict(config.detector),
        "simulator": dict(config.simulator),
        "car": asdict(config.car),
        f"strategy {strategy}": dict(config.samplers[strategy]),
    }
    now = json.loads(json.dumps(now))
    known = json.loads(path.read_text()) if path.exists() else {}
    for key, value in now.items():
        if known.get(key, value) != value:
            raise InputError(
                f"{path}: tables there were recorded with another '{key}'; delete them and this key to record them again"
            )
    write_json(path, {**known, **now})


def campaign_plan(
    config: Config, folder: Path, campaign: CampaignId, settings: Mapping[str, Any], tests: int
) -> CampaignPlan:
    """A campaign on the shipped uniform base. folder: for the exported model."""
    described = functional_scenario(campaign.scenario)
    return CampaignPlan(
        campaign=campaign,
        space=described.logical_space(),
        tests=tests,
        failure_threshold_s=config.campaign.failure_threshold_s,
        strategy=settings,
        setup=Setup(
            config.simulator,
            described,
            config.detector,
            onnx_of(BASE, folder),
            config.car,
            config.limits,
        ),
    )


def record_campaign(
    plan: CampaignPlan, sampler: Sampler, path: Path, folder: Path, threads: int
) -> None:
    """Execute a campaign, resuming from the journal in `folder`, and write its table."""
    campaign = plan.campaign
    label = f"{campaign.scenario} {campaign.strategy} {campaign.seed}"
    with closing(Workers(threads, plan.setup)) as workers, Progress(label) as progress:
        log = Journal(folder, plan.identity, progress)
        table = _table(plan, search(plan, OnGrid(sampler, plan.space), log, workers, progress))
    recorded.write(table, path)
    shutil.rmtree(folder)
    print(
        f"{path}: {len(table)} tests, {int(table['failure'].sum())} failures, {int((table['status'] == 'error').sum())} errors"
    )


def _table(plan: CampaignPlan, done: Sequence[Executed]) -> pd.DataFrame:
    rows: list[dict[str, Any]] = []
    for test in done:
        kpi = float(f"{test.kpi.adj_ttc_s:.{DIGITS}g}")
        judged = {"adj_ttc_s": kpi, **{name: getattr(test.kpi, name) for name in recorded.JUDGED}}
        rows.append({"status": test.outcome.status, **judged, **plan.space.decode(test.point)})
    return pd.DataFrame(rows)


if __name__ == "__main__":
    main()
