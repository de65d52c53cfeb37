"""Which expectations of docs/results/thesis.md the recorded campaigns of `study=thesis` meet."""

from __future__ import annotations

from collections.abc import Sequence

from grid import SCENARIOS, Campaign, Grid

from pipeline.core.measures import c_measure, failure_sequence, kinds_of

ADAPTIVE = ("evolutionary", "linear", "network", "gaussian_process", "forest")
AT_LEAST_RANDOM = 7
TIMES, TIMES_IN = 5, 6
SAVED = 0.75
MORE_KINDS, NOT_FEWER = 6, 5
FIRST_FAILURES = (498, 341, 521, 81, 483, 0, 198, 524)
FIRST_KINDS = (222, 14, 126, 6, 102, 0, 4, 277)
"""Failures and kinds of the first version of `forest`, F1 to F8."""


def expectations(grid: Grid) -> str:
    """How many campaigns are there, and a table: what was expected in how many scenarios, in how many of the finished ones it holds."""
    asked = len(SCENARIOS) * (len(ADAPTIVE) + 2)
    rows = [_at_least_random(grid, name) for name in ADAPTIVE]
    finished = [scenario for scenario in SCENARIOS if all((scenario, name) in grid for name in ("random", *ADAPTIVE))]
    best = [_best(grid, scenario) for scenario in finished]
    times = [each.failures >= TIMES * max(grid[each.scenario, "random"].failures, 1) for each in best]
    rows.append(_row(f"the strategy with most failures: {TIMES} × as many as `random`", TIMES_IN, times))
    saved = [_most_saved(grid, scenario) >= SAVED for scenario in finished]
    rows.append(_row(f"the strategy that saves most tests: C of at least {SAVED}", len(SCENARIOS), saved))
    ours = [(place, grid[scenario, "forest"]) for place, scenario in enumerate(SCENARIOS) if (scenario, "forest") in grid]
    more = [kinds_of(each.space, each.failing) > FIRST_KINDS[place] for place, each in ours]
    rows.append(_row("`forest`: more kinds than its first version", MORE_KINDS, more))
    rows.append(_row("at least as many failures as its first version", NOT_FEWER, [each.failures >= FIRST_FAILURES[p] for p, each in ours]))
    said = "All campaigns are finished." if len(grid) == asked else f"**{len(grid)} of {asked} campaigns are finished.**"
    header = ["| expected | in scenarios | holds | of finished | reached |", "|---|---|---|---|---|"]
    return "\n".join([said, "", *header, *rows]) + "\n"


def _at_least_random(grid: Grid, strategy: str) -> str:
    finished = [scenario for scenario in SCENARIOS if {(scenario, strategy), (scenario, "random")} <= set(grid)]
    holds = [grid[scenario, strategy].failures >= grid[scenario, "random"].failures for scenario in finished]
    return _row(f"`{strategy}`: at least as many failures as `random`", AT_LEAST_RANDOM, holds)


def _row(words: str, wanted: int, holds: Sequence[bool]) -> str:
    still_open = len(SCENARIOS) - len(holds)
    reached = "yes" if sum(holds) >= wanted else "open" if sum(holds) + still_open >= wanted else "**no**"
    return f"| {words} | {wanted} | {sum(holds)} | {len(holds)} | {reached} |"


def _best(grid: Grid, scenario: str) -> Campaign:
    return max((grid[scenario, name] for name in ADAPTIVE), key=lambda each: each.failures)


def _most_saved(grid: Grid, scenario: str) -> float:
    """C of the adaptive strategy that saves most; minus infinity if none found as many failures as random testing."""
    baseline = failure_sequence(grid[scenario, "random"].tests["failure"])
    saved = [c_measure(failure_sequence(grid[scenario, name].tests["failure"]), baseline)[1] for name in ADAPTIVE]
    return max((each for each in saved if each is not None), default=float("-inf"))
