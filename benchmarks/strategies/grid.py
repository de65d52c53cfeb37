"""The tables and figures of thesis chapter 6 from our own campaigns of `study=thesis`, beside the thesis' numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill

import numpy as np
import pandas as pd
import recorded
from matplotlib.figure import Figure
from PIL import Image

from pipeline.config.components import make_detector, make_simulator
from pipeline.config.composing import compose, functional_scenario
from pipeline.core.distance import relevance
from pipeline.core.measures import c_measure, failure_sequence, kinds_of, pair_coverage
from pipeline.core.samplers.meta_model import MetaModelSampler
from pipeline.core.space import Floats, Space
from pipeline.core.statistics import wilson_interval
from pipeline.report.replays import Replay, draw_replay, most_telling_frame
from pipeline.report.search_plots import kpi_panels, parallel_lines

GRID = recorded.DATA / "thesis"
BATCH = 20
LATE = 500
META_MODELS = ("linear", "network", "gaussian_process")
CANDIDATES = 2000
"""Random candidates that the relevance score judges by all tests of a campaign."""
FIRST = 300
NAMES = {
    "random": "Random Testing",
    "pairwise": "Pair-wise",
    "evolutionary": "Evolutionary",
    "linear": "LR",
    "network": "NNR",
    "gaussian_process": "GPR",
}
"""Our strategies by their names in the thesis; `forest` is ours alone."""
SCENARIOS = tuple(f"F{number}" for number in range(1, 9))
THESIS_FAILURES = {
    "random": (1, 4, 2, 0, 0, 0, 6, 0),
    "pairwise": (0, 1, 0, 2, 0, 2, 4, 0),
    "evolutionary": (1, 28, 6, 19, 24, 91, 118, 11),
    "linear": (0, 36, 32, 13, 4, 38, 63, 7),
    "network": (3, 42, 38, 23, 15, 38, 159, 21),
    "gaussian_process": (3, 40, 11, 15, 12, 38, 107, 8),
}
"""Thesis Tables 6.3 and 6.4, F1 to F8."""
THESIS_SAVED = {
    "pairwise": (None, None, None, 0.34, None, 0.58, None, None),
    "evolutionary": (0.75, 0.57, -2.35, 0.98, 0.93, 0.79, 0.79, 0.75),
    "linear": (None, 0.77, 0.58, 0.82, 0.86, 0.92, 0.80, 0.84),
    "network": (-0.12, 0.88, 0.85, 0.92, 1.00, 0.87, 0.79, 0.79),
    "gaussian_process": (-0.08, 0.70, 0.35, 0.85, 0.84, 0.94, 0.83, 0.97),
}
"""Thesis Table 6.5; None: fewer failures than random testing."""
THESIS_GAMMA_F = {
    "random": (0.2, 0.8, 0.4, 0.0, 0.0, 0.0, 1.2, 0.0),
    "pairwise": (0.0, 0.2, 0.0, 0.4, 0.0, 0.4, 0.8, 0.0),
    "evolutionary": (0.2, 3.3, 0.9, 2.4, 2.2, 7.3, 8.3, 1.6),
    "linear": (0.0, 5.2, 4.9, 2.3, 0.8, 5.4, 8.5, 1.3),
    "network": (0.6, 6.4, 5.6, 3.9, 2.7, 5.7, 16.4, 3.6),
    "gaussian_process": (0.6, 5.6, 2.1, 2.6, 2.2, 5.5, 12.0, 1.5),
}
THESIS_GAMMA_T = {
    "random": (78.6, 78.9, 78.9, 78.5, 78.7, 78.5, 78.9, 78.9),
    "pairwise": (100.0,) * 8,
    "evolutionary": (54.4, 57.7, 55.7, 57.1, 57.2, 58.5, 57.1, 57.3),
    "linear": (65.0, 65.6, 67.0, 65.2, 68.2, 66.8, 65.7, 65.4),
    "network": (70.6, 70.9, 72.5, 68.5, 70.4, 70.2, 67.4, 72.8),
    "gaussian_process": (67.4, 65.8, 65.7, 66.8, 65.1, 65.2, 65.6, 68.7),
}
"""Thesis Table 6.6, in %."""


@dataclass(frozen=True)
class Campaign:
    """tests: its rows in order, with the columns of tests.parquet that the plots read. points: (n, d)."""

    scenario: str
    strategy: str
    space: Space
    tests: pd.DataFrame
    points: Floats

    @property
    def failures(self) -> int:
        return int(self.tests["failure"].sum())

    @property
    def failing(self) -> Floats:
        chosen: Floats = self.points[self.tests["failure"].to_numpy(bool)]
        return chosen


Grid = Mapping[tuple[str, str], Campaign]
"""Campaigns by scenario and strategy."""
Cell = Callable[[Grid, Campaign], str]


def read(folder: Path = GRID) -> Grid:
    """The recorded campaigns; InputError if there is none."""
    grid = {}
    for scenario in SCENARIOS:
        if not any(folder.glob(f"{scenario}-*.csv.gz")):
            continue
        space = functional_scenario(scenario).logical_space()
        for strategy, path in recorded.paths_of(scenario, folder).items():
            tests, points = recorded.campaign(path, space)
            place = np.arange(len(tests))
            grid[scenario, strategy] = Campaign(
                scenario,
                strategy,
                space,
                tests.assign(index=place, batch=place // BATCH, seed=0, strategy=strategy),
                points,
            )
    if not grid:
        recorded.paths_of(SCENARIOS[0], folder)  # Names the command.
    return grid


def markdown(grid: Grid) -> str:
    """Failures (Tables 6.3, 6.4), C-measure (6.5) and pair coverage (6.6), ours / the thesis', and kinds of failures."""
    scenarios = [scenario for scenario in SCENARIOS if any(key[0] == scenario for key in grid)]
    strategies = [
        name
        for name in [*NAMES, *sorted({key[1] for key in grid} - set(NAMES))]
        if any(key[1] == name for key in grid)
    ]
    parts: list[tuple[str, Cell]] = [
        ("### Failures in 1,000 tests (Tables 6.3 and 6.4): ours / thesis", _failures),
        ("### Tests saved against random testing, C (Table 6.5): ours / thesis", _saved),
        (
            "### Share of pairs that the failures cover, γ_f in % (Table 6.6): ours / thesis",
            _gamma_f,
        ),
        ("### Share of pairs that the tests cover, γ_t in % (Table 6.6): ours / thesis", _gamma_t),
        ("### Kinds of failures: different pairs of person and pose (not in the thesis)", _kinds),
        (
            f"### Lowest adj. TTC in s, and share of the last {LATE} tests with their most frequent kind in %",
            _focus,
        ),
    ]
    tables = [
        f"{heading}\n\n{_table(grid, strategies, scenarios, cell)}\n" for heading, cell in parts
    ]
    return "\n".join([*tables, _rates(grid), _relevance_and_pairs(grid)])


def _table(grid: Grid, strategies: Sequence[str], scenarios: Sequence[str], cell: Cell) -> str:
    lines = [f"| strategy | {' | '.join(scenarios)} |", "|---" * (len(scenarios) + 1) + "|"]
    for strategy in strategies:
        cells = [
            cell(grid, grid[scenario, strategy]) if (scenario, strategy) in grid else ""
            for scenario in scenarios
        ]
        if any(cells):
            label = f"{strategy} ({NAMES[strategy]})" if strategy in NAMES else strategy
            lines.append(f"| {label} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _failures(_: Grid, campaign: Campaign) -> str:
    theirs = THESIS_FAILURES.get(campaign.strategy)
    return str(campaign.failures) + (
        f" / {theirs[SCENARIOS.index(campaign.scenario)]}" if theirs else ""
    )


def _saved(grid: Grid, campaign: Campaign) -> str:
    if campaign.strategy == "random" or (campaign.scenario, "random") not in grid:
        return ""
    sequences = [
        failure_sequence(each.tests["failure"])
        for each in (campaign, grid[campaign.scenario, "random"])
    ]
    theirs = THESIS_SAVED.get(campaign.strategy)
    ours = _number(c_measure(*sequences)[1])
    return ours + (f" / {_number(theirs[SCENARIOS.index(campaign.scenario)])}" if theirs else "")


def _number(value: float | None) -> str:
    return "n/a" if value is None else f"{value:.2f}"


def _gamma_f(_: Grid, campaign: Campaign) -> str:
    return _covered(campaign, campaign.failing, THESIS_GAMMA_F)


def _gamma_t(_: Grid, campaign: Campaign) -> str:
    return _covered(campaign, campaign.points, THESIS_GAMMA_T)


def _covered(campaign: Campaign, points: Floats, thesis: Mapping[str, Sequence[float]]) -> str:
    theirs = thesis.get(campaign.strategy)
    ours = f"{100 * pair_coverage(campaign.space, points):.1f}"
    return ours + (f" / {theirs[SCENARIOS.index(campaign.scenario)]:.1f}" if theirs else "")


def _kinds(_: Grid, campaign: Campaign) -> str:
    return str(kinds_of(campaign.space, campaign.failing))


def _focus(_: Grid, campaign: Campaign) -> str:
    kind = [
        variable.name for variable in campaign.space.variables if variable.kind == "categorical"
    ]
    late = campaign.tests.tail(LATE)[kind].value_counts(normalize=True)
    return f"{campaign.tests['adj_ttc_s'].min():.2f} / {100 * late.iloc[0]:.0f}"


def _rates(grid: Grid) -> str:
    """One sentence: how often random tests fail, with Wilson intervals."""
    said = []
    for (scenario, strategy), campaign in grid.items():
        if strategy == "random":
            valid = int((campaign.tests["status"] == "ok").sum())
            low, high = wilson_interval(campaign.failures, valid)
            said.append(
                f"{scenario} {campaign.failures / valid:.1%} ({100 * low:.1f} to {100 * high:.1f})"
            )
    return fill(f"Random tests that fail, with 95 % intervals: {', '.join(said)}.", 150) + "\n"


def _relevance_and_pairs(grid: Grid) -> str:
    """Two sentences: how much the relevance score restricts the meta-models, and how many pairs some random tests cover."""
    generator = np.random.default_rng(0)
    judged = []
    for ours in (campaign for (_, strategy), campaign in grid.items() if strategy in META_MODELS):
        candidates, failures = (
            ours.space.sample(CANDIDATES, generator),
            ours.tests["failure"].to_numpy(bool),
        )
        judged.append(
            relevance(ours.space, candidates, ours.points, failures, MetaModelSampler.epsilon)
        )
    kept_out = sum(int((scores <= MetaModelSampler.omega_threshold).sum()) for scores in judged)
    covered = [
        100 * pair_coverage(ours.space, ours.points[:FIRST])
        for (_, strategy), ours in grid.items()
        if strategy == "random"
    ]
    said = (
        f"Judged by all tests of a campaign of `linear`, `network` or `gaussian_process`, ω keeps out {kept_out} of "
        f"{CANDIDATES * len(judged):,} random candidates. The first {FIRST} random tests cover {min(covered):.0f} to "
        f"{max(covered):.0f} % of the pairs."
    )
    return fill(said, 150) + "\n"


def figures(grid: Grid, threshold_s: float) -> Iterator[tuple[str, Figure]]:
    """Name and figure: random tests of all scenarios (Figures 6.1, 6.2), and failures as lines (Figures 6.3, 6.5)."""
    random = {
        scenario: campaign
        for (scenario, strategy), campaign in grid.items()
        if strategy == "random"
    }
    if random:
        yield (
            "random",
            kpi_panels(
                {scenario: each.tests for scenario, each in random.items()}, threshold_s, columns=4
            ),
        )
    if most := most_failing(grid):
        title = f"{most.scenario}, random testing: {most.failures} failures"
        yield (
            "random-failures",
            parallel_lines({"random": most.tests[most.tests["failure"]]}, most.space, title),
        )
    both = [
        scenario
        for scenario in random
        if {(scenario, name) for name in ("evolutionary", "gaussian_process")} <= set(grid)
    ]
    if both:
        # As the thesis did: where the lead of evolutionary testing is largest.
        scenario = max(
            both,
            key=lambda name: (
                grid[name, "evolutionary"].failures - grid[name, "gaussian_process"].failures
            ),
        )
        for strategy in ("evolutionary", "gaussian_process"):
            yield f"{strategy.replace('_', '-')}-failures", _shared(grid[scenario, strategy])


def _shared(campaign: Campaign) -> Figure:
    """The failures as lines; those that share the most frequent value of a continuous variable have a colour (Figure 6.5)."""
    failing = campaign.tests[campaign.tests["failure"]]
    continuous = [
        variable.name for variable in campaign.space.variables if variable.kind == "continuous"
    ]
    counts = {name: failing[name].value_counts() for name in continuous} if len(failing) else {}
    title = f"{campaign.scenario}, {campaign.strategy}: {campaign.failures} failures"
    if not counts:
        return parallel_lines({"failures": failing}, campaign.space, title)
    name = max(counts, key=lambda each: counts[each].iloc[0])
    value = counts[name].index[0]
    same = failing[name] == value
    return parallel_lines(
        {"others": failing[~same], f"{name} = {value:g}": failing[same]}, campaign.space, title
    )


def extracts(campaign: Campaign, model: Path, count: int = 2) -> Image.Image:
    """The most telling moments of the first failures, one below the other (Figure 6.4). model: an ONNX file. Executes them again."""
    study, scenario = compose("thesis", []), functional_scenario(campaign.scenario)
    simulator, detector = (
        make_simulator(study.simulator, scenario, study.car),
        make_detector(study.detector, model),
    )
    moments = []
    for place, point in enumerate(campaign.failing[:count], 1):
        concrete = campaign.space.decode(point)
        episode = simulator.execute(concrete, detector, keep_every=1)
        title = f"{campaign.scenario}, {campaign.strategy}: failure {place} of {campaign.failures}"
        replay = Replay(
            episode, title, concrete, study.campaign.failure_threshold_s, campaign.space.units
        )
        moments.append(draw_replay(replay)[most_telling_frame(episode)])
    return Image.fromarray(np.concatenate(moments))


def threshold_s() -> float:
    """adj. TTC of a failure, in seconds."""
    return compose("thesis", []).campaign.failure_threshold_s


def most_failing(grid: Grid) -> Campaign | None:
    """The random campaign with most failures; None if no random test failed."""
    random = [
        campaign
        for (_, strategy), campaign in grid.items()
        if strategy == "random" and campaign.failures
    ]
    return max(random, key=lambda each: each.failures, default=None)
