"""Confirms a rule by fresh random tests inside and just outside it, which no search has seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.core.counted import Counted
from pipeline.core.rules import Bools, Condition, Rule
from pipeline.core.space import Floats, Space, Variable

CHUNK, MAX_DRAWS = 1000, 1000
MARGIN = 0.1
"""How far beyond a bound "just outside" reaches, as a share of the variable's range."""
Filter = Callable[[Floats], Bools]
"""Which values (n,) of a condition's column are wanted, as (n,)."""


class NarrowError(ValueError):
    """A rule admits hardly any feasible point."""


def draw_inside(space: Space, rule: Rule, count: int, rng: np.random.Generator) -> Floats:
    """(count, d) feasible points inside a rule, independent and uniform; NarrowError if it admits hardly any."""
    return _drawn(
        space, [(condition, condition.admits) for condition in rule.conditions], count, rng
    )


def draw_just_outside(space: Space, rule: Rule, count: int, rng: np.random.Generator) -> Floats:
    """(count, d) feasible points just outside a rule: each breaks one condition and keeps the others.

    The condition is drawn with equal chances. A number lies beyond its bound by at most `MARGIN` of the range, and an integer by at most 1
    where that is more; of a category, any other value may stand. Empty, (0, d), if no condition can be broken alone.
    """
    nearby = []
    for broken in rule.conditions:
        kept = [
            (condition, condition.admits)
            for condition in rule.conditions
            if condition is not broken
        ]
        try:
            nearby.append(
                _drawn(space, [(broken, _beyond(broken, broken.subject(space))), *kept], count, rng)
            )
        except NarrowError:  # Such as an adult who is a child.
            continue
    if not nearby:
        return np.zeros((0, len(space)))
    return np.array(
        [nearby[which][row] for row, which in enumerate(rng.integers(len(nearby), size=count))]
    )


def _beyond(condition: Condition, variable: Variable) -> Filter:
    def just_outside(column: Floats) -> Bools:
        outside = ~condition.admits(column)
        if condition.values:
            return outside
        period = variable.high - variable.low
        gaps = [np.abs(column - bound) for bound in (condition.low, condition.high)]
        if variable.cyclic:
            gaps = [np.minimum(gap, period - gap) for gap in gaps]
        reach = max(MARGIN * period, 1.0 if variable.kind == "integer" else 0.0)
        return np.asarray(outside & (np.minimum(*gaps) <= reach))

    return just_outside


def _drawn(
    space: Space, wanted: Sequence[tuple[Condition, Filter]], count: int, rng: np.random.Generator
) -> Floats:
    """Points by rejection: first of each variable's values, then of points. wanted: conditions, each with the values of its column."""
    alone = {
        j: [holds for condition, holds in wanted if condition.variable == j and not condition.sign]
        for j in range(len(space))
    }
    points = np.zeros((0, len(space)))
    for _ in range(MAX_DRAWS):
        if len(points) >= count:
            return points[:count]
        drawn = np.column_stack(
            [_values(v, alone[j], max(CHUNK, count), rng) for j, v in enumerate(space.variables)]
        )
        kept = (
            space.constraints.holds(space.categorise(drawn))
            if space.clauses
            else np.ones(len(drawn), bool)
        )
        for condition, holds in wanted:
            if condition.sign:
                kept &= holds(condition.column(drawn))
        points = np.concatenate([points, drawn[kept]])
    raise NarrowError(
        f"no {count} feasible points in {MAX_DRAWS} draws: the constraints exclude almost all that the rule admits"
    )


def _values(
    variable: Variable, filters: Sequence[Filter], count: int, rng: np.random.Generator
) -> Floats:
    values = np.zeros(0)
    for _ in range(MAX_DRAWS):
        drawn = variable.scale(rng.random(max(CHUNK, count)))
        for wanted in filters:
            drawn = drawn[wanted(drawn)]
        values = np.concatenate([values, drawn])
        if len(values) >= count:
            return values[:count]
    raise NarrowError(f"{variable.name}: the rule admits hardly any value")


def more_inside(inside: Counted, outside: Counted) -> float:
    """Fisher's exact test, one-sided: the chance of at least so many failures inside if the failure rates inside and outside were equal.
    In [0, 1]; 1 if one side has no tests."""
    if not inside.tests or not outside.tests:
        return 1.0
    from scipy.stats import hypergeom

    tests, failures = inside.tests + outside.tests, inside.failures + outside.failures
    return float(hypergeom.sf(inside.failures - 1, tests, failures, inside.tests))


def confirmed(counts: Sequence[tuple[Counted, Counted]], alpha: float) -> list[bool]:
    """Whether each of several rules is confirmed: more failures inside it than just outside, at a chance of at most alpha that any rule
    without meaning is. counts: inside and outside of each rule. Holm 1979."""
    chances = [more_inside(inside, outside) for inside, outside in counts]
    result, order = [False] * len(chances), np.argsort(chances, kind="stable")
    for rank, index in enumerate(order):
        if chances[index] > alpha / (len(chances) - rank):
            break
        result[index] = True
    return result
