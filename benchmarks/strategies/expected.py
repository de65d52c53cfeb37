"""Which expectations of docs/results/thesis.md the recorded campaigns of `study=thesis` meet."""

from __future__ import annotations

from collections.abc import Sequence

from grid import SCENARIOS, Campaign, Grid

from pipeline.core.measures import c_measure, failure_sequence, kinds_of, pair_coverage

ADAPTIVE = ("evolutionary", "linear", "network", "gaussian_process", "forest")
AT_LEAST_RANDOM = 7
TIMES, TIMES_IN = 5, 6
SAVED = 0.75
MORE_KINDS, NOT_FEWER = 6, 5
FIRST = {
    "failures": (498, 341, 521, 81, 483, 0, 198, 524),
    "kinds": (222, 14, 126, 6, 102, 0, 4, 277),
}
THIRD = {
    "failures": (558, 353, 552, 113, 576, 249, 281, 671),
    "kinds": (275, 5, 25, 3, 231, 1, 4, 394),
    "gamma_f": (40.6, 17.4, 32.9, 8.4, 34.6, 14.8, 13.1, 46.0),
}
"""What the first and the third version of `forest` found on F1 to F8; γ_f in %."""
MORE_THAN_THIRD = 5


def expectations(grid: Grid) -> str:
    """How many campaigns are there, and a table: what was expected in how many scenarios, in how many of the finished ones it holds."""
    asked = len(SCENARIOS) * (len(ADAPTIVE) + 2)
    rows = [_at_least_random(grid, name) for name in ADAPTIVE]
    finished = [
        scenario
        for scenario in SCENARIOS
        if all((scenario, name) in grid for name in ("random", *ADAPTIVE))
    ]
    best = [_best(grid, scenario) for scenario in finished]
    times = [
        each.failures >= TIMES * max(grid[each.scenario, "random"].failures, 1) for each in best
    ]
    rows.append(
        _row(f"the strategy with most failures: {TIMES} × as many as `random`", TIMES_IN, times)
    )
    saved = [_most_saved(grid, scenario) >= SAVED for scenario in finished]
    rows.append(
        _row(f"the strategy that saves most tests: C of at least {SAVED}", len(SCENARIOS), saved)
    )
    more = [third > first for third, first in zip(THIRD["kinds"], FIRST["kinds"], strict=True)]
    rows.append(_row("the third `forest`: more kinds than the first", MORE_KINDS, more))
    not_fewer = [
        third >= first for third, first in zip(THIRD["failures"], FIRST["failures"], strict=True)
    ]
    rows.append(
        _row("the third `forest`: at least as many failures as the first", NOT_FEWER, not_fewer)
    )
    rows += _of_the_fourth(grid)
    said = (
        "All campaigns are finished."
        if len(grid) == asked
        else f"**{len(grid)} of {asked} campaigns are finished.**"
    )
    header = [
        "| expected | in scenarios | holds | of finished | reached |",
        "|---|---|---|---|---|",
    ]
    return "\n".join([said, "", *header, *rows]) + "\n"


def _at_least_random(grid: Grid, strategy: str) -> str:
    finished = [
        scenario
        for scenario in SCENARIOS
        if {(scenario, strategy), (scenario, "random")} <= set(grid)
    ]
    holds = [
        grid[scenario, strategy].failures >= grid[scenario, "random"].failures
        for scenario in finished
    ]
    return _row(f"`{strategy}`: at least as many failures as `random`", AT_LEAST_RANDOM, holds)


def _of_the_fourth(grid: Grid) -> list[str]:
    ours = [
        (place, grid[scenario, "forest"])
        for place, scenario in enumerate(SCENARIOS)
        if (scenario, "forest") in grid
    ]
    kinds = [kinds_of(each.space, each.failing) > THIRD["kinds"][place] for place, each in ours]
    pairs = [
        round(100 * pair_coverage(each.space, each.failing), 1) > THIRD["gamma_f"][place]
        for place, each in ours
    ]
    return [
        _row("the fourth `forest`: more kinds than the third", MORE_THAN_THIRD, kinds),
        _row("the fourth `forest`: a higher γ_f than the third", MORE_THAN_THIRD, pairs),
    ]


def _row(words: str, wanted: int, holds: Sequence[bool]) -> str:
    still_open = len(SCENARIOS) - len(holds)
    reached = (
        "yes" if sum(holds) >= wanted else "open" if sum(holds) + still_open >= wanted else "**no**"
    )
    return f"| {words} | {wanted} | {sum(holds)} | {len(holds)} | {reached} |"


def _best(grid: Grid, scenario: str) -> Campaign:
    return max((grid[scenario, name] for name in ADAPTIVE), key=lambda each: each.failures)


def _most_saved(grid: Grid, scenario: str) -> float:
    """C of the adaptive strategy that saves most; minus infinity if none found as many failures as random testing."""
    baseline = failure_sequence(grid[scenario, "random"].tests["failure"])
    saved = [
        c_measure(failure_sequence(grid[scenario, name].tests["failure"]), baseline)[1]
        for name in ADAPTIVE
    ]
    return max((each for each in saved if each is not None), default=float("-inf"))
