"""What a condition of a rule may be about: variables, sums and differences, attributes of values, and words, each with its price."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, xlogy

from pipeline.core.rules import Bools, Condition, combined
from pipeline.core.space import Floats, Space, Variable
from pipeline.core.words import Meaning, Word, meanings

LEVELS = 20
"""About the number of round bounds of an attribute; a numeric variable has at most twice as many."""
PRECISE = 5
"""Precise bounds for each round one."""
DIGITS = 9
IMPOSSIBLE = -np.inf


@dataclass(frozen=True)
class Offer:
    """A condition. price: length of its description, in nats. gain: log-likelihood gain of the rule that it completes, less this price."""

    condition: Condition
    price: float
    gain: float


class Description(Protocol):
    """One thing that a condition may be about."""

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        """The condition that pays most among the tests that the other conditions of a rule admit.

        inside, failed: (n,). None if no condition raises the share of failures.
        """
        ...


def describe(space: Space, points: Floats, words: Sequence[Word]) -> list[Description]:
    """Everything that conditions on points (n, d) may be about."""
    known = meanings(space, words)
    made = [
        made
        for j, variable in enumerate(space.variables)
        for made in _of_variable(j, variable, points[:, j])
    ]
    made += [
        made
        for pair in combinations(range(len(space)), 2)
        for made in _of_pair(space, pair, points)
    ]
    if known:
        made += [
            _Words(tuple(word for word in known if word.variable == j), points[:, j])
            for j in sorted({w.variable for w in known})
        ]
    price = float(np.log(len(made)))
    return [_Priced(one, price) for one in made]


def likelihood_gain(hits: NDArray[Any], support: NDArray[Any], failed: Bools) -> Floats:
    """How much better than one rate for all tests two rates, inside and outside a rule, explain the outcomes, in nats.

    hits, support: failures and tests inside, of any shape. failed: (n,), all tests. -inf if the rate inside is not the higher one.
    """
    tests, failures = len(failed), int(failed.sum())
    # A search tries thousands of candidates. Logarithms take most of its time, and those worse than no rule need none.
    better = hits * tests > failures * support
    right, within = hits[better], support[better]
    gain = np.full(np.shape(hits), IMPOSSIBLE)
    gain[better] = _likelihood(right, within) + _likelihood(failures - right, tests - within)
    return gain - _likelihood(np.array(failures), np.array(tests))


def _likelihood(hits: NDArray[Any], tests: NDArray[Any]) -> Floats:
    share = hits / np.maximum(tests, 1)
    return np.asarray(xlogy(hits, share) + xlogy(tests - hits, 1 - share))


@dataclass(frozen=True)
class _Priced:
    """A description whose conditions also pay for saying which description it is."""

    description: Description
    price: float

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        offer = self.description.best(inside, failed)
        return offer and Offer(offer.condition, offer.price + self.price, offer.gain - self.price)


def _of_variable(index: int, variable: Variable, column: Floats) -> Iterator[Description]:
    if variable.kind != "categorical":
        yield _Interval(
            Condition(index),
            column,
            *_bounds(variable),
            variable.cyclic,
            single=variable.kind == "integer",
        )
        return
    yield _Values(index, column, variable.size)
    for name, numbers in variable.attributes:
        if len(set(numbers)) > 1:
            yield _Attribute(index, name, np.array(numbers), column)


@dataclass(frozen=True)
class _Ends:
    """The best interval: the indices of its bounds, its price and its gain less that price."""

    low: int
    high: int
    price: float
    gain: float


def _of_pair(space: Space, pair: tuple[int, int], points: Floats) -> Iterator[Description]:
    """The sum and the difference of two variables that can be compared, because they have one unit and one range."""
    first, second = (space.variables[j] for j in pair)
    alike = (first.unit, first.low, first.high, first.cuts) == (
        second.unit,
        second.low,
        second.high,
        second.cuts,
    )
    if (
        not alike
        or {first.kind, second.kind} != {"continuous"}
        or first.cyclic
        or second.cyclic
        or first.cuts is not None
    ):
        return
    for sign in (1, -1):
        column = points[:, pair[0]] + sign * points[:, pair[1]]
        yield _Interval(
            Condition(pair[0], other=pair[1], sign=sign),
            column,
            *_bounds(combined(first, second, sign)),
            single=False,
        )


def _bounds(variable: Variable) -> tuple[Floats, Floats]:
    """Bounds (b,) that a condition on a numeric variable may have, and the price of each: a round number costs less than a precise one."""
    rounded = max(variable.rounding, (variable.high - variable.low) / LEVELS / 2)
    precise = rounded / PRECISE
    if variable.kind == "integer":
        narrow = (
            variable.high - variable.low <= 2 * LEVELS * PRECISE
        )  # Then each number may be a bound.
        precise = 1.0 if narrow else max(1.0, np.floor(precise))
        rounded = max(1.0, np.floor(variable.rounding)) if narrow else precise * PRECISE
    bounds = np.append(np.arange(variable.low, variable.high - precise / 2, precise), variable.high)
    steps = (bounds - variable.low) / rounded
    is_round = np.abs(steps - np.round(steps)) < 1e-6
    prices = np.where(is_round, np.log(3 * is_round.sum()), np.log(6 * len(bounds)))
    return np.round(bounds, DIGITS), prices if variable.cyclic else _open_ends(prices)


def _open_ends(prices: Floats) -> Floats:
    """Prices of bounds, (b,), the first and last of which say that there is no bound."""
    opened = prices.copy()
    opened[[0, -1]] = np.log(2)
    return opened


@dataclass(frozen=True)
class _Interval:
    """Intervals of a column (n,) between bounds (b,) with their prices, (b,); both ends are included. about: a condition on the column.

    single: whether an interval may be one number, which random values of a continuous variable never are.
    """

    about: Condition
    column: Floats
    bounds: Floats
    prices: Floats
    cyclic: bool = False
    single: bool = True

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        found = self.ends(inside, failed)
        if found is None:
            return None
        condition = replace(
            self.about, low=float(self.bounds[found.low]), high=float(self.bounds[found.high])
        )
        return Offer(condition, found.price, found.gain)

    def ends(self, inside: Bools, failed: Bools) -> _Ends | None:
        """The best interval; None if none raises the share of failures."""
        support, hits = self._between(inside), self._between(inside & failed)
        if self.cyclic:
            support, hits = (
                support + self._backwards * inside.sum(),
                hits + self._backwards * (inside & failed).sum(),
            )
        else:
            support, hits = support * (1 - self._backwards), hits * (1 - self._backwards)
        gains = likelihood_gain(hits, support, failed) - self._pair_prices
        if not self.single:
            np.fill_diagonal(gains, IMPOSSIBLE)
        best = float(gains.max())
        if best == IMPOSSIBLE:
            return None
        # Intervals that admit the same tests are equally good: the middle one errs least.
        tied = np.argwhere(gains >= best - 1e-9)
        middle = _middle(tied[:, 0], 0), _middle(tied[:, 1], len(self.bounds) - 1)
        # The middle of the ends need not be one of these intervals, so the nearest one counts.
        first, last = map(int, tied[np.abs(tied - middle).sum(axis=1).argmin()])
        return _Ends(first, last, float(self._pair_prices[first, last]), best)

    def _between(self, rows: Bools) -> NDArray[np.int64]:
        """Number of the rows' values from bound i to bound j, as (b, b) at [i, j]; for j < i, minus the number between."""
        first_above, first_at = self._positions
        count = len(self.bounds)
        below, up_to = (
            np.cumsum(np.bincount(bound[rows], minlength=count + 1))[:count]
            for bound in (first_above, first_at)
        )
        return np.asarray(up_to[None, :] - below[:, None], dtype=np.int64)

    @cached_property
    def _positions(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Index of the first bound above each value, and of the first at or above it, (n,) each."""
        return np.searchsorted(self.bounds, self.column, side="right"), np.searchsorted(
            self.bounds, self.column, side="left"
        )

    @cached_property
    def _backwards(self) -> NDArray[np.int64]:
        """1 where an interval from bound i to bound j ends before it begins, (b, b) at [i, j]: on a circle, it runs through the end."""
        return np.tri(len(self.bounds), k=-1, dtype=np.int64)

    @cached_property
    def _pair_prices(self) -> Floats:
        """Price of the interval from bound i to bound j, (b, b) at [i, j]."""
        return np.asarray(self.prices[:, None] + self.prices[None, :])


def _middle(tied: NDArray[np.int64], end: int) -> int:
    return end if (tied == end).any() else int(np.median(tied))


@dataclass(frozen=True)
class _Attribute:
    """Intervals of an attribute of a categorical variable. numbers: (v,), of each value. column: (n,), encoded values."""

    variable: int
    name: str
    numbers: Floats
    column: Floats

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        bounds, found = self._interval.bounds, self._interval.ends(inside, failed)
        if found is None:
            return None
        values = tuple(
            np.flatnonzero(
                (self.numbers >= bounds[found.low]) & (self.numbers <= bounds[found.high])
            ).tolist()
        )
        return Offer(
            Condition(self.variable, values=values, text=self._text(bounds, found.low, found.high)),
            found.price,
            found.gain,
        )

    @cached_property
    def _interval(self) -> _Interval:
        bounds = _readable(self.numbers)
        prices = _open_ends(np.full(len(bounds), np.log(2 * len(bounds))))
        return _Interval(
            Condition(self.variable), self.numbers[self.column.astype(np.int64)], bounds, prices
        )

    def _text(self, bounds: Floats, low: int, high: int) -> str:
        first, last = f"{bounds[low]:g}", f"{bounds[high]:g}"
        if low == high:
            return f"{self.name} = {first}"
        if low == 0:
            return f"{self.name} <= {last}"
        return (
            f"{self.name} >= {first}"
            if high == len(bounds) - 1
            else f"{self.name} in [{first}, {last}]"
        )


def _readable(numbers: Floats) -> Floats:
    """Round bounds around (v,) numbers, about `LEVELS` of them; the numbers themselves if they are fewer."""
    known = np.unique(numbers)
    if len(known) <= LEVELS:
        return known
    exact = (known[-1] - known[0]) / LEVELS
    power = 10.0 ** np.floor(np.log10(exact))
    unit = power * next(step for step in (1, 2, 5, 10) if step * power >= exact)
    # A text shows a bound without the rounding error of its product, so it must have none.
    return np.asarray(
        np.round(np.arange(np.floor(known[0] / unit), np.ceil(known[-1] / unit) + 1) * unit, DIGITS)
    )


@dataclass(frozen=True)
class _Values:
    """Sets of the values of a categorical variable. column: (n,), encoded. size: number of values."""

    variable: int
    column: Floats
    size: int

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        column = self.column.astype(np.int64)
        support, hits = (
            np.bincount(column[inside], minlength=self.size),
            np.bincount(column[inside & failed], minlength=self.size),
        )
        with_hits = np.flatnonzero(hits)
        if not len(with_hits) or self.size == 1:
            return None
        # For a convex measure the best set is a prefix of the values ordered by their rate (Breiman et al. 1984, theorem 4.5). But values
        # have a price, so one with many failures may pay more than several with a single one: the second order is by what each pays.
        rate = hits / np.maximum(support, 1)
        alone = likelihood_gain(hits, support, failed)
        offers = [
            self._prefix(
                with_hits[np.argsort(-by[with_hits], kind="stable")], hits, support, failed
            )
            for by in (rate, alone)
        ]
        return max(
            (offer for offer in offers if offer is not None),
            key=lambda offer: offer.gain,
            default=None,
        )

    def _prefix(
        self,
        order: NDArray[np.int64],
        hits: NDArray[np.int64],
        support: NDArray[np.int64],
        failed: Bools,
    ) -> Offer | None:
        """The best of the sets that hold the first values of an order; hits, support: (size,)."""
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
        return Offer(
            Condition(self.variable, values=tuple(sorted(order[: best + 1].tolist()))),
            float(prices[best]),
            float(gains[best]),
        )


@dataclass(frozen=True)
class _Words:
    """The words of one categorical variable. column: (n,), encoded."""

    known: tuple[Meaning, ...]
    column: Floats

    def best(self, inside: Bools, failed: Bools) -> Offer | None:
        hits, support = (self._admitted[:, rows].sum(axis=1) for rows in (inside & failed, inside))
        price = float(np.log(len(self.known)))
        gains = likelihood_gain(hits, support, failed) - price
        best = int(np.argmax(gains))
        return (
            None
            if gains[best] == IMPOSSIBLE
            else Offer(self._conditions[best], price, float(gains[best]))
        )

    @cached_property
    def _conditions(self) -> tuple[Condition, ...]:
        return tuple(
            Condition(word.variable, values=word.values, text=word.text, order=word.order)
            for word in self.known
        )

    @cached_property
    def _admitted(self) -> Bools:
        """Whether each word admits each test, (words, n)."""
        return np.array([condition.admits(self.column) for condition in self._conditions])
