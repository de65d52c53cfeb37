"""Records the rendered tests from which the emulators of a scenario are made: half random, half chosen by a strategy.

    python benchmarks/strategies/record.py --scenario F1 [--tests 4000] [--strategy forest] [--threads 2]

Executes the default study's car with the shipped uniform base and writes benchmarks/strategies/data/F1.csv.gz, and F1.json about it.
Finished tests stay in the folder `--journal` until then, so the same command resumes a killed run, unless the program has changed.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Sequence
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
from pipeline.execution.campaign import CampaignPlan, Executed, sampler_seed, search
from pipeline.execution.journal import Journal
from pipeline.execution.workers import Setup, Workers
from pipeline.progress import Progress
from pipeline.protocols import Sampler

BASE = Path("models/uniform")
DIGITS = 5
"""Significant digits of a recorded KPI."""


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
    """Execute both halves and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", required=True)
    parser.add_argument("--tests", type=int, default=4000, help="in all")
    parser.add_argument("--strategy", default="forest", help="of the second half")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=2, help="processes that execute tests")
    parser.add_argument("--journal", type=Path, default=Path("data/strategies/recording"))
    parser.add_argument("--out", type=Path, default=recorded.DATA)
    options = parser.parse_args()
    try:
        record(options)
    except InputError as error:
        parser.error(str(error))


def record(options: argparse.Namespace) -> None:
    config, folder = compose("default", []), options.journal / options.scenario
    if options.strategy not in config.samplers:
        raise InputError(f"there is no strategy '{options.strategy}'{nearest(options.strategy, list(config.samplers))}")
    if options.strategy == "random":
        raise InputError("--strategy must be another than random, which is the first half")
    model = onnx_of(BASE, folder)
    halves = {"random": options.tests // 2, options.strategy: options.tests - options.tests // 2}
    plans = [_plan(config, options, model, name, tests) for name, tests in halves.items()]
    tables = [_table(plan, _executed(plan, folder, options.threads)) for plan in plans]
    table = pd.concat(tables)
    recorded.write(table, options.out / f"{options.scenario}.csv.gz")
    write_json(options.out / f"{options.scenario}.json", _about(config, options, table))
    shutil.rmtree(folder)
    print(table.groupby("strategy", sort=False)["failure"].agg(tests="size", failures="sum").to_string())


def _plan(config: Config, options: argparse.Namespace, model: Path, strategy: str, tests: int) -> CampaignPlan:
    described = functional_scenario(options.scenario)
    campaign = CampaignId(options.scenario, strategy, "base", options.seed)
    # Random tests need no results, so in one batch no process waits for another.
    batch = {"batch_size": tests} if strategy == "random" else {}
    return CampaignPlan(
        campaign=campaign,
        space=described.logical_space(),
        tests=tests,
        failure_threshold_s=config.campaign.failure_threshold_s,
        strategy={**config.samplers[strategy], **batch},
        strategy_seed=sampler_seed(campaign),
        setup=Setup(config.simulator, described, config.detector, model, config.car),
    )


def _executed(plan: CampaignPlan, folder: Path, threads: int) -> list[Executed]:
    workers = Workers(threads, plan.setup)
    try:
        with Progress(f"{plan.campaign.scenario} {plan.campaign.strategy}") as progress:
            log = Journal(folder / plan.campaign.strategy, plan.identity)
            if log.discarded:
                progress.note("the journal belonged to another configuration, model or code and was discarded")
            return search(plan, OnGrid(plan.sampler(), plan.space), log, workers, progress)
    finally:
        workers.close()


def _table(plan: CampaignPlan, done: Sequence[Executed]) -> pd.DataFrame:
    rows: list[dict[str, Any]] = []
    for test in done:
        kpi = float(f"{test.kpi.adj_ttc_s:.{DIGITS}g}")
        status = "error" if test.outcome.is_error else "ok"
        row = {"strategy": plan.campaign.strategy, "status": status, "adj_ttc_s": kpi, "failure": test.kpi.failure}
        rows.append(row | plan.space.decode(test.point))
    return pd.DataFrame(rows)


def _about(config: Config, options: argparse.Namespace, table: pd.DataFrame) -> dict[str, Any]:
    """What the tests were executed with."""
    return {
        "scenario": options.scenario,
        "weights_sha256": sha256(BASE / "weights.safetensors"),
        "detector": dict(config.detector),
        "car": asdict(config.car),
        "strategy": {"name": options.strategy, **config.samplers[options.strategy]},
        "seed": options.seed,
        "tests": len(table),
        "errors": int((table["status"] == "error").sum()),
        "failures": {str(name): int(count) for name, count in table.groupby("strategy")["failure"].sum().items()},
    }


if __name__ == "__main__":
    main()
