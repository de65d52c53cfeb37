"""Does the order of the benchmark hold where every test is rendered?

    python benchmarks/strategies/confirm.py [--scenario F1 F5 F7 F8] [--strategy forest network] [--threads 2]

Each strategy searches each scenario with three seeds, 300 rendered tests each, on the shipped uniform base with the default study's
settings. Writes benchmarks/strategies/data/confirmation/SEED/SCENARIO-STRATEGY.csv.gz and prints the table of all that are there. Finished
tables and tests are kept, so the same command resumes. verifai-ce and other peers need the environment of requirements.txt.
"""

from __future__ import annotations

import argparse
from functools import cache
from pathlib import Path
from textwrap import fill

import contestants
import pandas as pd
import recorded
from duels import DEFAULT, LINE, THESIS
from record import campaign_plan, record_campaign

from pipeline.config.composing import compose, functional_scenario
from pipeline.config.schema import Config
from pipeline.core.identity import CampaignId
from pipeline.core.measures import kinds_of, pair_coverage
from pipeline.errors import InputError

SCENARIOS = ("F1", "F5", "F7", "F8")
"""None of them served development, and F7 not the emulators either."""
STRATEGIES = ("forest", "network", "exploit", "evolutionary", "gaussian_process")
SEEDS = (1, 2, 3)
"""0 are the tests from which the emulators learnt."""
TESTS = 300
DATA = recorded.DATA / "confirmation"


def main() -> None:
    """Execute the campaigns that have no table yet, and print what all found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", nargs="+", default=list(SCENARIOS))
    parser.add_argument("--strategy", nargs="+", default=list(STRATEGIES))
    parser.add_argument("--threads", type=int, default=2, help="processes that execute tests")
    parser.add_argument("--journal", type=Path, default=Path("data/strategies/confirmation"))
    parser.add_argument("--out", type=Path, default=DATA)
    options = parser.parse_args()
    try:
        for scenario in options.scenario:
            for seed in SEEDS:
                for strategy in options.strategy:
                    _confirm(
                        compose("default", []),
                        CampaignId(scenario, strategy, "base", seed),
                        options,
                    )
        print(answer(measured(options.out)))
    except InputError as error:
        parser.error(str(error))


def _confirm(config: Config, campaign: CampaignId, options: argparse.Namespace) -> None:
    path = recorded.path_of(campaign.scenario, campaign.strategy, options.out / str(campaign.seed))
    if not path.exists():
        plan = campaign_plan(
            config,
            options.journal,
            campaign,
            {"strategy": contestants.digest(campaign.strategy)},
            TESTS,
        )
        sampler = contestants.make(campaign.strategy, plan.space, plan.strategy_seed)
        record_campaign(
            plan, sampler, path, options.journal / str(campaign.seed) / path.stem, options.threads
        )


def measured(folder: Path = DATA) -> pd.DataFrame:
    """A row for each recorded campaign: `scenario`, `strategy`, `seed`, `tests`, and failures, kinds and γ_f after all of them."""
    rows, space_of = [], cache(lambda scenario: functional_scenario(scenario).logical_space())
    for path in sorted(folder.glob("*/*.csv.gz")):
        scenario, _, strategy = path.name.removesuffix(".csv.gz").partition("-")
        space = space_of(scenario)
        table, points = recorded.campaign(path, space)
        failing = points[table["failure"].to_numpy(bool)]
        found = {
            "failures": len(failing),
            "kinds": kinds_of(space, failing),
            "gamma_f": pair_coverage(space, failing),
        }
        rows.append(
            {
                "scenario": scenario,
                "strategy": strategy,
                "seed": int(path.parent.name),
                "tests": len(table),
                **found,
            }
        )
    return pd.DataFrame(rows)


def answer(rows: pd.DataFrame) -> str:
    """In how many scenarios the default leads the thesis' network, and the table."""
    means = {
        name: rows[rows["strategy"] == name].groupby("scenario")[["failures", "gamma_f"]].mean()
        for name in (DEFAULT, THESIS)
    }
    ahead = means[DEFAULT] > means[THESIS].reindex(means[DEFAULT].index)
    both = ahead.index.intersection(means[THESIS].index)
    failures, pairs = ahead.loc[both].sum()
    said = (
        f"Rendered, `{DEFAULT}` finds more failures than `{THESIS}` in {failures} of {len(both)} scenarios, and its failures cover more "
        f"pairs of categories in {pairs}."
    )
    return f"{fill(said, LINE)}\n\n{markdown(rows)}"


def markdown(rows: pd.DataFrame) -> str:
    """Means over seeds with their lowest and highest, a row for each strategy and scenario."""
    lines = [
        "| scenario | strategy | seeds | failures | kinds | γ_f, % |",
        "|---|---|---|---|---|---|",
    ]
    for (scenario, strategy), group in rows.groupby(["scenario", "strategy"]) if len(rows) else ():
        cells = [
            _spread(group["failures"]),
            _spread(group["kinds"]),
            _spread(100 * group["gamma_f"]),
        ]
        lines.append(f"| {scenario} | {strategy} | {len(group)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _spread(values: pd.Series) -> str:
    return f"{values.mean():.0f} ({values.min():.0f}–{values.max():.0f})"


if __name__ == "__main__":
    main()
