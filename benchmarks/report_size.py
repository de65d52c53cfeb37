"""Size of a report, and how long a browser takes to paint it and to fill its table.

    python benchmarks/report_size.py [--tests 50000] [--page data/default/report.html] [--loads 5]

Fabricates the report of a search with so many tests, one in fifty of them a failure, with six films of the analytic simulator. With --page,
it measures a finished page instead. First paint is Chromium's own entry `first-contentful-paint`; the table is filled when the page says
so. Each is the median over several loads, in a fresh browser at 1600 × 1000 pixels.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from pipeline.analysis.failure_regions import cluster
from pipeline.analysis.measures import by_strategy, measure_campaign, summarise
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tables import TESTS
from pipeline.config.composing import compose
from pipeline.config.schema import Config
from pipeline.core.identity import CampaignId
from pipeline.core.space import Space
from pipeline.report.contents import draw_figures, make_page
from pipeline.report.data import ReportData
from pipeline.report.page import render

FAILING = 50
"""One test in so many fails: in fog from 60 % on, with the lowest sun."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tests", type=int, default=50_000)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--loads", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        page = options.page or fabricated(options.tests, Path(folder))
        loads = [painted(page.resolve()) for _ in range(options.loads)]
        size = page.stat().st_size / 1e6
    first, filled = (median(times) for times in zip(*loads, strict=True))
    print(
        f"{size:.1f} MB; first paint after {first:.2f} s, table filled after {filled:.2f} s ({options.loads} loads, median)"
    )


def painted(page: Path) -> tuple[float, float]:
    """Seconds from the start of a load until the first paint, and until the table is filled."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox", "--disable-gpu"]
        )
        opened = browser.new_page(viewport={"width": 1600, "height": 1000})
        opened.goto(page.as_uri())
        opened.wait_for_selector("#explorer[data-ready]", timeout=120_000)
        filled_ms = opened.evaluate("performance.now()")
        first_ms = opened.evaluate(
            "performance.getEntriesByName('first-contentful-paint')[0].startTime"
        )
        browser.close()
    return first_ms / 1000, filled_ms / 1000


def fabricated(tests: int, folder: Path) -> Path:
    """A page with so many tests in the default study's campaigns."""
    config = compose("default", ["simulator=analytic", "detector=oracle"])
    started, spaces = time.perf_counter(), {name: config.space(name) for name in config.search}
    every = campaigns(config)
    tables = {
        campaign: rows_of(campaign, spaces[campaign.scenario], tests // len(every))
        for campaign in every
    }
    by_scenario = {
        name: pd.concat(
            [rows for key, rows in tables.items() if key.scenario == name], ignore_index=True
        )
        for name in spaces
    }
    rows = pd.concat(by_scenario.values(), ignore_index=True)
    measured = [measure_campaign(campaign, tables, spaces, "random") for campaign in tables]
    groups = tuple(summarise(group, 0.95, "random", {"random"}) for group in by_strategy(measured))
    infos = [ScenarioInfo(name, config.scenarios[name].label, "", 1) for name in spaces]
    data = ReportData(
        version="base",
        measures=Measures(
            confidence=0.95, baseline="random", campaigns=tuple(measured), strategies=groups
        ),
        regions=tuple(
            cluster(info, spaces[info.name], by_scenario[info.name], config.regions)
            for info in infos
        ),
        scenarios={info.name: (info, spaces[info.name]) for info in infos},
        rows=rows,
        learnt=rows,
        detectors={"base": Path()},
        frames=(),
        files={},
    )
    figures = draw_figures(data, list(config.strategies), config.campaign.failure_threshold_s)
    page = folder / "report.html"
    page.write_text(render(make_page(config, data, figures, lambda *_: None)))
    print(
        f"{sum(map(len, tables.values())):,} tests, {sum(one.failures for one in data.regions):,} failures"
    )
    print(f"the page is made in {time.perf_counter() - started:.0f} s")
    return page


def campaigns(config: Config) -> list[CampaignId]:
    return [
        CampaignId(a, strategy, "base", seed)
        for a in config.search
        for strategy in config.strategies
        for seed in config.seeds
    ]


def rows_of(campaign: CampaignId, space: Space, count: int) -> pd.DataFrame:
    """Rows of tests.parquet."""
    points = space.sample(
        count,
        np.random.default_rng([campaign.seed, len(campaign.strategy), ord(campaign.scenario[1])]),
    )
    fog, altitude = (
        points[:, space.names.index("fog")],
        points[:, space.names.index("sun_altitude")],
    )
    failed = (fog >= 60) & (
        altitude <= np.quantile(altitude[fog >= 60], 1 / (FAILING * np.mean(fog >= 60)))
    )
    numbers = np.arange(count)
    columns: dict[str, Any] = {column.name: 0 for column in TESTS}
    known = {
        "scenario": campaign.scenario,
        "strategy": campaign.strategy,
        "version": campaign.version,
        "seed": campaign.seed,
    }
    return pd.DataFrame(columns, index=range(count)).assign(
        **known,
        test_id=[str(test) for test in campaign.tests(count)],
        index=numbers,
        batch=numbers // 20,
        status="ok",
        reason="",
        adj_ttc_s=np.where(failed, 0.05, 0.2 + (100 - fog) / 60),
        failure=failed,
        failure_mode=np.where(failed, np.where(numbers % 2, "contact", "late"), "none"),
        cause=np.where(failed, "confidence", "none"),
        contact=failed & (numbers % 2 == 1),
        **{
            variable.name: [variable.decode(value) for value in points[:, place]]
            for place, variable in enumerate(space.variables)
        },
    )


if __name__ == "__main__":
    main()
