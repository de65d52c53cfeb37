"""Confirms a rule by fresh random tests inside and just outside it, which no search has seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.core.counted import Counted
from pipeline.core.rules import Bools, Condition, Rule
from pipeline.core.space import Floats, Space, Variable
from pipeline.core.statistics import holm

CHUNK, MAX_DRAWS = 1000, 1000
MARGIN = 0.1
"""How far beyond a bound "just outside" reaches, as a share of the variable's range."""
Filter = Callable[[Floats], Bools]
"""Which values (n,) of a condition's column are wanted, as (n,)."""


class NarrowError(ValueError):
    """A rule admits hardly any feasible point."""


def draw_inside(space: Space, rule: Rule, count: int, rng: np.random.Generator) -> Floats:
    """Independent, uniform feasible points inside a rule, (count, d).

    Raises:
        NarrowError: the rule admits hardly any feasible point.
    """
    filters = [(condition, condition.admits) for condition in rule.conditions]
    return _drawn(space, filters, count, rng)


def draw_just_outside(space: Space, rule: Rule, count: int, rng: np.random.Generator) -> Floats:
    """Feasible points just outside a rule, (count, d): each breaks one condition alone.

    The condition is drawn with equal chances. A number lies beyond its bound by at most `MARGIN` of
    the range, or 1 for an integer if that is more; a category may have any other value.

    Returns:
        (count, d) points; (0, d) if no condition can be broken alone.
    """
    nearby = []
    for broken in rule.conditions:
        filters: list[tuple[Condition, Filter]] = [(broken, _just_outside(broken, space))]
        for condition in rule.conditions:
            if condition is not broken:
                filters.append((condition, condition.admits))
        try:
            nearby.append(_drawn(space, filters, count, rng))
        except NarrowError:  # Such as an adult who is a child.
            continue
    if not nearby:
        return np.zeros((0, len(space)))
    chosen = rng.integers(len(nearby), size=count)
    return np.array([nearby[which][row] for row, which in enumerate(chosen)])


def _just_outside(condition: Condition, space: Space) -> Filter:
    variable = condition.subject(space)

    def is_just_outside(column: Floats) -> Bools:
        outside = ~condition.admits(column)
        if condition.values:
            return outside
        period = variable.high - variable.low
        gaps = [np.abs(column - bound) for bound in (condition.low, condition.high)]
        if variable.cyclic:
            gaps = [np.minimum(gap, period - gap) for gap in gaps]
        reach = max(MARGIN * period, 1.0 if variable.kind == "integer" else 0.0)
        return np.asarray(outside & (np.minimum(*gaps) <= reach))

    return is_just_outside


def _drawn(
    space: Space, filters: Sequence[tuple[Condition, Filter]], count: int, rng: np.random.Generator
) -> Floats:
    """Points by rejection: first of each variable's values, then of points.

    filters: conditions, each with the wanted values of its column.
    """
    of_variable: list[list[Filter]] = [[] for _ in space.variables]
    for condition, holds in filters:
        if not condition.sign:
            of_variable[condition.variable].append(holds)
    points = np.zeros((0, len(space)))
    for _ in range(MAX_DRAWS):
        if len(points) >= count:
            return points[:count]
        columns = []
        for variable, variable_filters in zip(space.variables, of_variable, strict=True):
            columns.append(_values(variable, variable_filters, max(CHUNK, count), rng))
        drawn = np.column_stack(columns)
        kept = np.ones(len(drawn), bool)
        if space.clauses:
            kept = space.constraints.holds(space.categorise(drawn))
        for condition, holds in filters:
            if condition.sign:
                kept &= holds(condition.column(drawn))
        points = np.concatenate([points, drawn[kept]])
    raise NarrowError(
        f"no {count} feasible points in {MAX_DRAWS} draws: "
        "the constraints exclude almost all that the rule admits"
    )


def _values(
    variable: Variable, filters: Sequence[Filter], count: int, rng: np.random.Generator
) -> Floats:
    values = np.zeros(0)
    for _ in range(MAX_DRAWS):
        drawn = variable.scale(rng.random(max(CHUNK, count)))
        for holds in filters:
            drawn = drawn[holds(drawn)]
        values = np.concatenate([values, drawn])
        if len(values) >= count:
            return values[:count]
    raise NarrowError(f"{variable.name}: the rule admits hardly any value")


def more_inside(inside: Counted, outside: Counted) -> float:
    """One-sided p-value of Fisher's exact test: more failures inside a rule than outside.

    Returns:
        Chance of at least so many failures inside if both failure rates were equal, in [0, 1]; 1
        if one side has no tests.

    >>> round(more_inside(Counted(tests=10, failures=8), Counted(tests=10, failures=1)), 4)
    0.0027
    """
    if not inside.tests or not outside.tests:
        return 1.0
    from scipy.stats import hypergeom

    tests, failures = inside.tests + outside.tests, inside.failures + outside.failures
    return float(hypergeom.sf(inside.failures - 1, tests, failures, inside.tests))


def confirmed(counts: Sequence[tuple[Counted, Counted]], alpha: float) -> list[bool]:
    """Whether each of several rules is confirmed: more failures inside it than just outside.

    Args:
        counts: outcomes inside and outside of each rule.
        alpha: largest chance that any rule without meaning is confirmed (Holm 1979).
    """
    return holm([more_inside(inside, outside) for inside, outside in counts], alpha)
