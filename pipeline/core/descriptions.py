"""Subjects of a rule's conditions: variables, sums and differences, attributes and words.

Each description has a price: the length of the text that states it, in nats.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, xlogy

from pipeline.core.rules import Bools, Condition, combined
from pipeline.core.space import Floats, Space, Variable
from pipeline.core.words import Meaning, Word, meanings

LEVELS = 20
"""About the number of round bounds of an attribute; a numeric variable has at most twice that."""
PRECISE = 5
"""Precise bounds for each round one."""
DIGITS = 9
IMPOSSIBLE = -np.inf


@dataclass(frozen=True)
class Offer:
    """A condition that a description proposes for a rule.

    price: length of its description, in nats.
    gain: log-likelihood gain of the rule that it completes, less this price.
    """

    condition: Condition
    price: float
    gain: float


class Description(Protocol):
    """Something that a condition may be about."""

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        """The condition that gains most among the tests that a rule's other conditions admit.

        Args:
            inside: (n,) whether the other conditions admit each test.
            failed: (n,) whether each test failed.

        Returns:
            The best condition; None if no condition raises the share of failures.
        """
        ...


def describe(space: Space, points: Floats, words: Sequence[Word]) -> list[Description]:
    """Everything that conditions on points (n, d) may be about."""
    descriptions: list[Description] = []
    for j, variable in enumerate(space.variables):
        descriptions += _of_variable(j, variable, points[:, j])
    for pair in combinations(range(len(space)), 2):
        descriptions += _of_pair(space, pair, points)
    all_meanings = meanings(space, words)
    for j in sorted({meaning.variable for meaning in all_meanings}):
        of_variable = [meaning for meaning in all_meanings if meaning.variable == j]
        descriptions.append(_Words(of_variable, points[:, j]))
    price = float(np.log(len(descriptions)))
    return [_Priced(description, price) for description in descriptions]


def likelihood_gain(hits: NDArray[Any], support: NDArray[Any], failed: Bools) -> Floats:
    """Log-likelihood that separate failure rates inside and outside a rule gain over a common rate.

    Args:
        hits: failures that a rule admits, one number for each candidate rule, of any shape.
        support: tests that the rule admits, in the same shape.
        failed: (n,) whether each test failed.

    Returns:
        The gain in nats, in the shape of `hits`; -inf where the rate inside is not higher.

    >>> failed = np.arange(20) < 5
    >>> likelihood_gain(np.array([4, 1]), np.array([6, 6]), failed).round(2).tolist()
    [3.83, -inf]
    """
    tests, failures = len(failed), int(failed.sum())
    # A search tries thousands of candidates, and logarithms take most of its time.
    # Candidates that are worse than no rule need none.
    better = hits * tests > failures * support
    inner_hits, inner_tests = hits[better], support[better]
    gain = np.full(np.shape(hits), IMPOSSIBLE)
    gain[better] = _likelihood(inner_hits, inner_tests) + _likelihood(
        failures - inner_hits, tests - inner_tests
    )
    return gain - _likelihood(np.array(failures), np.array(tests))


def _likelihood(hits: NDArray[Any], tests: NDArray[Any]) -> Floats:
    share = hits / np.maximum(tests, 1)
    return np.asarray(xlogy(hits, share) + xlogy(tests - hits, 1 - share))


@dataclass(frozen=True)
class _Priced:
    """A description whose conditions also pay for the choice of this description."""

    description: Description
    price: float

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        offer = self.description.best(inside, failed)
        return offer and Offer(offer.condition, offer.price + self.price, offer.gain - self.price)


def _of_variable(index: int, variable: Variable, column: Floats) -> Iterator[Description]:
    if variable.kind != "categorical":
        bounds, prices = _bounds(variable)
        yield _Interval(
            Condition(index),
            column,
            bounds,
            prices,
            cyclic=variable.cyclic,
            single=variable.kind == "integer",
        )
        return
    yield _Values(index, column, variable.size)
    for name, numbers in variable.attributes:
        if len(set(numbers)) > 1:
            yield _Attribute(index, name, np.array(numbers), column)


def _of_pair(space: Space, pair: tuple[int, int], points: Floats) -> Iterator[Description]:
    """The sum and the difference of two continuous variables with the same unit and range."""
    first, second = (space.variables[j] for j in pair)
    for variable in (first, second):
        if variable.kind != "continuous" or variable.cyclic or variable.cuts is not None:
            return
    if (first.unit, first.low, first.high) != (second.unit, second.low, second.high):
        return
    for sign in (1, -1):
        bounds, prices = _bounds(combined(first, second, sign))
        subject = Condition(pair[0], other=pair[1], sign=sign)
        column = points[:, pair[0]] + sign * points[:, pair[1]]
        yield _Interval(subject, column, bounds, prices, single=False)


def _bounds(variable: Variable) -> tuple[Floats, Floats]:
    """Bounds of intervals of a numeric variable, (b,), and the price of each, lower if round."""
    rounded = max(variable.rounding, (variable.high - variable.low) / LEVELS / 2)
    precise = rounded / PRECISE
    if variable.kind == "integer":
        every_number = variable.high - variable.low <= 2 * LEVELS * PRECISE
        if every_number:
            precise, rounded = 1.0, max(1.0, np.floor(variable.rounding))
        else:
            precise = max(1.0, np.floor(precise))
            rounded = precise * PRECISE
    bounds = np.append(np.arange(variable.low, variable.high - precise / 2, precise), variable.high)
    steps = (bounds - variable.low) / rounded
    is_round = np.abs(steps - np.round(steps)) < 1e-6
    prices = np.where(is_round, np.log(3 * is_round.sum()), np.log(6 * len(bounds)))
    return np.round(bounds, DIGITS), prices if variable.cyclic else _open_ends(prices)


def _open_ends(prices: Floats) -> Floats:
    """Prices of bounds, (b,), if the first and the last one stand for "no bound"."""
    opened = prices.copy()
    opened[[0, -1]] = np.log(2)
    return opened


@dataclass(frozen=True)
class _Ends:
    """The best interval: the indices of its bounds, its price and its gain less that price."""

    low: int
    high: int
    price: float
    gain: float


class _Interval:
    """Intervals of a column of numbers; both ends are included."""

    def __init__(
        self,
        subject: Condition,
        column: Floats,
        bounds: Floats,
        prices: Floats,
        cyclic: bool = False,
        single: bool = True,
    ) -> None:
        """Intervals of a column (n,) between bounds (b,), which have prices (b,).

        subject: a condition on the column, without an interval. single: whether an interval may
        be a single number, which random values of a continuous variable never hit.
        """
        self.bounds = bounds
        self._subject, self._cyclic, self._single = subject, cyclic, single
        # Index of the first bound above each value, and of the first at or above it, (n,) each.
        self._first_above = np.searchsorted(bounds, column, side="right")
        self._first_at = np.searchsorted(bounds, column, side="left")
        # Of the interval from bound i to bound j, (b, b) at [i, j]: its price, and 1 where it ends
        # before it begins, so that on a circle it passes the end of the range.
        self._prices = np.asarray(prices[:, None] + prices[None, :])
        self._backwards = np.tri(len(bounds), k=-1, dtype=np.int64)

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        ends = self.ends(inside, failed)
        if ends is None:
            return None
        low, high = float(self.bounds[ends.low]), float(self.bounds[ends.high])
        return Offer(replace(self._subject, low=low, high=high), ends.price, ends.gain)

    def ends(self, inside: Bools, failed: Bools) -> _Ends | None:
        """The best interval; None if none raises the share of failures."""
        support, hits = self._between(inside), self._between(inside & failed)
        gains = likelihood_gain(hits, support, failed) - self._prices
        if not self._single:
            np.fill_diagonal(gains, IMPOSSIBLE)
        best = float(gains.max())
        if best == IMPOSSIBLE:
            return None
        # Intervals that admit the same tests are equally good: the middle one errs least.
        tied = np.argwhere(gains >= best - 1e-9)
        middle = _middle(tied[:, 0], 0), _middle(tied[:, 1], len(self.bounds) - 1)
        # The middle of the ends need not be one of these intervals, so the nearest one counts.
        first, last = map(int, tied[np.abs(tied - middle).sum(axis=1).argmin()])
        return _Ends(first, last, float(self._prices[first, last]), best)

    def _between(self, rows: Bools) -> NDArray[np.int64]:
        """Number of the rows' values from bound i to bound j, as (b, b) at [i, j].

        For j < i: 0, or, on a circle, the number from bound i through the end to bound j.
        """
        count = len(self.bounds)
        below = np.cumsum(np.bincount(self._first_above[rows], minlength=count + 1))[:count]
        up_to = np.cumsum(np.bincount(self._first_at[rows], minlength=count + 1))[:count]
        between = np.asarray(up_to[None, :] - below[:, None], dtype=np.int64)
        if self._cyclic:
            return np.asarray(between + self._backwards * rows.sum())
        return between * (1 - self._backwards)


def _middle(tied: NDArray[np.int64], end: int) -> int:
    return end if (tied == end).any() else int(np.median(tied))


class _Attribute:
    """Intervals of an attribute of a categorical variable."""

    def __init__(self, variable: int, name: str, numbers: Floats, column: Floats) -> None:
        """numbers: (v,) the attribute of each value. column: (n,) encoded values."""
        self._variable, self._name, self._numbers = variable, name, numbers
        bounds = _readable(numbers)
        prices = _open_ends(np.full(len(bounds), np.log(2 * len(bounds))))
        column = numbers[column.astype(np.int64)]
        self._interval = _Interval(Condition(variable), column, bounds, prices)

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        bounds, ends = self._interval.bounds, self._interval.ends(inside, failed)
        if ends is None:
            return None
        low, high = bounds[ends.low], bounds[ends.high]
        values = np.flatnonzero((self._numbers >= low) & (self._numbers <= high))
        if ends.low == ends.high:
            text = f"{self._name} = {low:g}"
        elif ends.low == 0:
            text = f"{self._name} <= {high:g}"
        elif ends.high == len(bounds) - 1:
            text = f"{self._name} >= {low:g}"
        else:
            text = f"{self._name} in [{low:g}, {high:g}]"
        condition = Condition(self._variable, values=tuple(values.tolist()), text=text)
        return Offer(condition, ends.price, ends.gain)


def _readable(numbers: Floats) -> Floats:
    """Round bounds around (v,) numbers, about `LEVELS` of them; the numbers if they are fewer."""
    distinct = np.unique(numbers)
    if len(distinct) <= LEVELS:
        return distinct
    exact = (distinct[-1] - distinct[0]) / LEVELS
    power = 10.0 ** np.floor(np.log10(exact))
    unit = power * next(step for step in (1, 2, 5, 10) if step * power >= exact)
    steps = np.arange(np.floor(distinct[0] / unit), np.ceil(distinct[-1] / unit) + 1)
    # A text shows a bound without the rounding error of its product, so it must have none.
    return np.asarray(np.round(steps * unit, DIGITS))


@dataclass(frozen=True)
class _Values:
    """Sets of values of a categorical variable. column: (n,) encoded. size: number of values."""

    variable: int
    column: Floats
    size: int

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        column = self.column.astype(np.int64)
        support = np.bincount(column[inside], minlength=self.size)
        hits = np.bincount(column[inside & failed], minlength=self.size)
        with_hits = np.flatnonzero(hits)
        if not len(with_hits) or self.size == 1:
            return None
        # For a convex measure the best set is a prefix of the values ordered by their rate
        # (Breiman et al. 1984, theorem 4.5). But values have a price, so a value with many
        # failures may gain more than several with a single one: the second order is by gain.
        rate = hits / np.maximum(support, 1)
        gain_alone = likelihood_gain(hits, support, failed)
        offers = []
        for key in (rate, gain_alone):
            order = with_hits[np.argsort(-key[with_hits], kind="stable")]
            offer = self._prefix(order, hits, support, failed)
            if offer is not None:
                offers.append(offer)
        return max(offers, key=lambda offer: offer.gain, default=None)

    def _prefix(
        self,
        order: NDArray[np.int64],
        hits: NDArray[np.int64],
        support: NDArray[np.int64],
        failed: Bools,
    ) -> Offer | None:
        """The best of the sets of the first values of an order; hits, support: (size,)."""
        order = order[: self.size - 1]
        count = np.arange(1, len(order) + 1)
        prices = (
            gammaln(self.size + 1)
            - gammaln(count + 1)
            - gammaln(self.size - count + 1)
            + np.log(self.size)
        )
        gains = likelihood_gain(np.cumsum(hits[order]), np.cumsum(support[order]), failed) - prices
        best = int(np.argmax(gains))
        if gains[best] == IMPOSSIBLE:
            return None
        condition = Condition(self.variable, values=tuple(sorted(order[: best + 1].tolist())))
        return Offer(condition, float(prices[best]), float(gains[best]))


class _Words:
    """The words of one categorical variable."""

    def __init__(self, meanings: Sequence[Meaning], column: Floats) -> None:
        """column: (n,) encoded values."""
        self._conditions = [
            Condition(word.variable, values=word.values, text=word.text, order=word.order)
            for word in meanings
        ]
        # Whether each word admits each test, (words, n).
        self._admitted = np.array([condition.admits(column) for condition in self._conditions])

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        hits = self._admitted[:, inside & failed].sum(axis=1)
        support = self._admitted[:, inside].sum(axis=1)
        price = float(np.log(len(self._conditions)))
        gains = likelihood_gain(hits, support, failed) - price
        best = int(np.argmax(gains))
        if gains[best] == IMPOSSIBLE:
            return None
        return Offer(self._conditions[best], price, float(gains[best]))
