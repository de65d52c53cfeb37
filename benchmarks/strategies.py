"""How many failures, and of how many kinds, does each strategy find in the analytic world?

    python -m benchmarks.strategies run [--strategy forest ...] [--seeds 20] [KEY=VALUE ...]
    python -m benchmarks.strategies answer          the table of docs/results/strategies.md
    python -m benchmarks.strategies choose          the table of docs/howto/strategies.md

`run` replaces the published campaigns of its strategies and seeds. Each executes 1,000 tests of F1
on `simulator=analytic`, whose failure regions are planted; the oracle drives. KEY=VALUE overrides
the default study, such as `samplers.forest.kinds=1`; publish such campaigns with `--out` elsewhere.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.shared import RESULTS, markdown, pack, unpack
from pipeline.config.components import make_detector, make_sampler, make_world
from pipeline.config.composing import compose
from pipeline.core.kpi import evaluate
from pipeline.core.loop import run_test
from pipeline.core.measures import kinds_of, pair_coverage
from pipeline.core.space import Floats, Space
from pipeline.core.statistics import mean_interval
from pipeline.progress import Progress
from pipeline.protocols import Sampler

SCENARIO = "F1"
TESTS, SEEDS = 1000, 20
BUDGETS = (300, 1000)
"""Numbers of tests after which campaigns are compared."""
PUBLISHED = RESULTS / "strategies.csv"
COLUMNS = ["strategy", "seed", "tests", "cpu_s", "failed"]
COLUMNS += [f"{measure}_{budget}" for budget in BUDGETS for measure in ("kinds", "gamma_f")]


def main() -> None:
    """Execute campaigns, or print a table of the published ones."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    execute = commands.add_parser("run")
    execute.add_argument("--strategy", nargs="+", help="default: the published ones")
    execute.add_argument("--seeds", type=int, default=SEEDS)
    execute.add_argument("--processes", type=int, default=2)
    execute.add_argument("--out", type=Path, default=PUBLISHED)
    execute.add_argument("overrides", nargs="*", metavar="KEY=VALUE")
    commands.add_parser("answer")
    commands.add_parser("initial", help="evolutionary testing by its number of first tests")
    commands.add_parser("choose")
    options = parser.parse_args()
    if options.command == "run":
        strategies = options.strategy or sorted(pd.read_csv(PUBLISHED)["strategy"].unique())
        jobs = [(name, seed) for name in strategies for seed in range(options.seeds)]
        run(jobs, options.overrides, options.processes, options.out)
    elif options.command == "initial":
        print(initial())
    elif options.command == "answer":
        print(answer(pd.read_csv(PUBLISHED)))
    else:
        print(choose(pd.read_csv(PUBLISHED)))


def run(jobs: list[tuple[str, int]], overrides: list[str], processes: int, path: Path) -> None:
    """Execute the campaigns of strategies and seeds, and publish each as it ends."""
    with get_context("spawn").Pool(processes) as pool, Progress("strategies") as progress:
        rows = pool.imap_unordered(partial(campaign, overrides=overrides), jobs)
        for done, row in enumerate(rows, 1):
            publish(row, path)
            progress(done, len(jobs), f"{row['strategy']}, seed {row['seed']}")


def campaign(job: tuple[str, int], overrides: list[str]) -> dict[str, Any]:
    """The published row of a campaign, with the CPU-seconds that the strategy itself takes."""
    strategy, seed = job
    space, points, failed, spent_s = searched(strategy, seed, overrides)
    row: dict[str, Any] = {"strategy": strategy, "seed": seed, "tests": TESTS}
    row |= {"cpu_s": round(spent_s, 6), "failed": pack(failed)}
    for budget in BUDGETS:
        failing = points[:budget][failed[:budget]]
        row[f"kinds_{budget}"] = kinds_of(space, failing)
        row[f"gamma_f_{budget}"] = round(pair_coverage(space, failing), 6)
    return row


def initial() -> str:
    """Evolutionary testing with 20 first tests, our default, and with 300, as in the thesis."""
    rows = []
    for first in (20, 300):
        for seed in range(3):
            words = [f"samplers.evolutionary.initial={first}"]
            space, points, failed, _ = searched("evolutionary", seed, words)
            covered = f"{100 * pair_coverage(space, points):.0f}"
            rows.append((first, seed, int(failed.sum()), covered))
    return markdown(("first tests", "seed", "failures", "γ_t, %"), rows)


def searched(
    strategy: str, seed: int, overrides: list[str]
) -> tuple[Space, Floats, NDArray[np.bool_], float]:
    """The space, the points of a campaign, whether each failed, and the strategy's CPU-seconds."""
    config = compose("default", ["simulator=analytic", "detector=oracle", *overrides])
    space, threshold_s = config.space(SCENARIO), config.campaign.failure_threshold_s
    world = make_world(config.simulator, config.scenarios[SCENARIO], config.car.vehicle)
    detector = make_detector(config.detector, Path())

    def kpi(points: Floats) -> Floats:
        """The adjusted TTC of (n, d) points, (n,) seconds."""
        episodes = (run_test(world, detector, config.car, space.decode(point)) for point in points)
        return np.array([evaluate(each.signals, threshold_s).adj_ttc_s for each in episodes])

    with threadpool_limits(1):
        sampler = make_sampler(config.samplers[strategy], space, seed)
        points, values, spent_s = search(sampler, kpi, TESTS)
    return space, points, values <= threshold_s, spent_s


def search(
    sampler: Sampler, kpi: Callable[[Floats], Floats], tests: int
) -> tuple[Floats, Floats, float]:
    """Points (tests, d), KPI (tests,) in order, and the CPU-seconds of asking and telling."""
    points: list[Floats] = []
    values: list[Floats] = []
    spent_s = 0.0
    while sum(map(len, values)) < tests:
        begin = time.process_time()
        asked = sampler.ask()
        spent_s += time.process_time() - begin
        outcomes = kpi(asked)
        begin = time.process_time()
        sampler.tell(asked, outcomes)
        spent_s += time.process_time() - begin
        points.append(asked)
        values.append(outcomes)
    return np.concatenate(points)[:tests], np.concatenate(values)[:tests], spent_s


def publish(row: dict[str, Any], path: Path) -> None:
    """Put a campaign in the place of the one with its strategy and seed."""
    table = pd.read_csv(path) if path.exists() else pd.DataFrame(columns=COLUMNS)
    same = (table["strategy"] == row["strategy"]) & (table["seed"] == row["seed"])
    rows = [*table[~same].to_dict("records"), row]
    table = pd.DataFrame(rows, columns=COLUMNS).sort_values(["strategy", "seed"])
    table.to_csv(path, index=False)


def scored(campaigns: pd.DataFrame) -> pd.DataFrame:
    """The campaigns with their failures after each budget and the milliseconds of a test."""
    failed = [unpack(*row) for row in zip(campaigns["failed"], campaigns["tests"], strict=True)]
    table = campaigns.assign(ms=1000 * campaigns["cpu_s"] / campaigns["tests"])
    for budget in BUDGETS:
        table[f"failures_{budget}"] = [int(outcomes[:budget].sum()) for outcomes in failed]
    return table


def answer(campaigns: pd.DataFrame) -> str:
    """What each strategy finds, means over the seeds with Student's 95 % intervals."""
    names = ["strategy", "seeds"]
    for budget in BUDGETS:
        names += [f"failures in {budget:,}", f"kinds in {budget:,}", f"γ_f in {budget:,}, %"]
    names.append("ms a test")
    rows = []
    for strategy, table in by_failures(campaigns):
        cells = [f"`{strategy}`", len(table)]
        for budget in BUDGETS:
            cells.append(spread(table[f"failures_{budget}"]))
            cells.append(spread(table[f"kinds_{budget}"]))
            cells.append(spread(100 * table[f"gamma_f_{budget}"]))
        rows.append([*cells, f"{table['ms'].mean():.1f}"])
    return markdown(names, rows)


def choose(campaigns: pd.DataFrame) -> str:
    """What each strategy finds in the smallest budget, means over the seeds."""
    budget = BUDGETS[0]
    rows = []
    for strategy, table in by_failures(campaigns):
        measures = [table[f"{name}_{budget}"].mean() for name in ("failures", "kinds", "gamma_f")]
        pairs = f"{100 * measures[2]:.0f} %"
        rows.append((f"`{strategy}`", f"{measures[0]:.0f}", f"{measures[1]:.0f}", pairs))
    return markdown(("strategy", "failures", "kinds", "pairs among the failures"), rows)


def by_failures(campaigns: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """The scored campaigns of each strategy, most failures in the smallest budget first."""
    table = scored(campaigns)
    means = table.groupby("strategy")[f"failures_{BUDGETS[0]}"].mean()
    for strategy in means.sort_values(ascending=False, kind="stable").index:
        yield str(strategy), table[table["strategy"] == strategy]


def spread(values: pd.Series) -> str:
    """A mean over seeds with its interval."""
    low, high = mean_interval(values.to_numpy(float))
    return f"{values.mean():.0f} ({low:.0f} to {high:.0f})"


if __name__ == "__main__":
    main()
