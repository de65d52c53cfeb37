"""A failure rate with its intervals, and the claim that it allows, in a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10

import numpy as np
from scipy import optimize, special

from pipeline.core.counted import Counted
from pipeline.core.space import Floats

CONFIDENCE = 0.95
TAIL = (1 - CONFIDENCE) / 2
TINY = 1e-12


@dataclass(frozen=True)
class Limits:
    """The 95 % interval [low, high] and the one-sided 95 % upper limit `below`, each in [0, 1]."""

    low: float
    high: float
    below: float


@dataclass(frozen=True)
class Rate:
    """A failure rate with its limits.

    Attributes:
        value: in [0, 1].
        limits: of the value.
        tests: tests without an error.
        failures: failures among them.
        errors: tests with an error, which are in no rate.
        note: what a reader must know beside the number; empty if nothing.

    Raises:
        ValueError: if the value is out of range.
    """

    value: float
    limits: Limits
    tests: int
    failures: int
    errors: int = 0
    note: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.value <= 1:
            raise ValueError(f"a failure rate must be in [0, 1], got {self.value}")


def exact(failures: int, tests: int) -> Limits:
    """Exact limits of a binomial proportion (Clopper & Pearson 1934); 0 and 1 without tests.

    They hold for a number of independent tests that was fixed before. With no failure in n tests,
    `below` is 1 - 0.05^(1/n).

    >>> round(exact(0, 100).below, 4)
    0.0295
    """
    counted = Counted(tests, failures)
    return Limits(*counted.interval(CONFIDENCE), below=counted.interval(1 - 4 * TAIL)[1])


def evidence(failures: int, tests: int, rate: float, above: bool) -> float:
    """Evidence that the true rate lies above or below a given rate (Robbins 1970).

    It is the likelihood averaged over all rates on that side, relative to that of `rate`. If the
    true rate is `rate`, or lies on its other side, the evidence ever exceeds log(1/α) with a
    probability of at most α, however often a person looks (Ville's inequality).

    Args:
        failures: number of failures.
        tests: number of independent tests.
        rate: in (0, 1).
        above: whether the side is above the rate.

    Returns:
        The natural logarithm of the evidence.

    >>> evidence(5, 10, rate=0.1, above=True) > evidence(2, 10, rate=0.1, above=True)
    True
    """
    seen = (failures + 1, tests - failures + 1)
    side, length = (special.betaincc, 1 - rate) if above else (special.betainc, rate)
    share = side(*seen, rate) / length
    with np.errstate(divide="ignore"):
        return float(
            np.log(share)
            - special.xlogy(failures, rate)
            - special.xlog1py(tests - failures, -rate)
            + special.betaln(*seen)
        )


def anytime(failures: int, tests: int) -> Limits:
    """Limits of a binomial proportion that hold at every moment at once; see `evidence`.

    They are wider than those of `exact`.

    >>> anytime(0, 100).below > exact(0, 100).below
    True
    """
    if tests == 0:
        return Limits(0.0, 1.0, 1.0)
    share = min(max(failures / tests, TINY), 1 - TINY)

    def limit(tail: float, above: bool) -> float:
        outer = TINY if above else 1 - TINY
        if evidence(failures, tests, outer, above) < -np.log(tail):
            return 0.0 if above else 1.0
        return float(
            optimize.brentq(
                lambda rate: evidence(failures, tests, rate, above) + np.log(tail), outer, share
            )
        )

    return Limits(limit(TAIL, True), limit(TAIL, False), limit(2 * TAIL, False))


def spread(value: float, effective: float) -> Limits:
    """Limits of an estimate that rests on weighted failures.

    The relative error is 1 / sqrt(effective); Student's t on the logarithm, because such estimates
    are skewed and never negative.

    Args:
        value: the estimate, in (0, 1].
        effective: number of independent failures that are worth as much, > 0.

    >>> limits = spread(0.01, effective=100)
    >>> round(limits.low, 4), round(limits.high, 4)
    (0.0082, 0.0122)
    """
    error, freedom = 1 / np.sqrt(effective), max(effective - 1, 1.0)
    reach, one_sided = (
        float(special.stdtrit(freedom, 1 - tail)) * error for tail in (TAIL, 2 * TAIL)
    )
    return Limits(*(float(min(1.0, value * np.exp(by))) for by in (-reach, reach, one_sided)))


def bounded(weights: Floats, largest: float, tests: float) -> Limits:
    """Limits of a mean of weighted failures, whatever bounded weights the unseen failures have.

    A gamma distribution with the weighted sum's variance, shifted by a failure of the largest
    weight; with equal weights, exact for a Poisson count (Fay & Feuer 1997, Statistics in Medicine
    16:791).

    Args:
        weights: (f,) of the failures.
        largest: bound of any weight.
        tests: the weight of all tests; their number if weights are 1 on average.

    >>> round(bounded(np.zeros(0), largest=1, tests=100).below, 4)
    0.03
    """
    value, variance = float(weights.sum()) / tests, float(weights @ weights) / tests**2
    most = largest / tests

    def quantile(share: float, mean: float, spread: float) -> float:
        chi_squared = 2 * special.gammaincinv(mean**2 / spread, share)
        return float(min(1.0, spread / (2 * mean) * chi_squared))

    low = quantile(TAIL, value, variance) if value > 0 else 0.0
    shifted = (value + most, variance + most**2)
    return Limits(low, quantile(1 - TAIL, *shifted), quantile(1 - 2 * TAIL, *shifted))


def combined(rates: Sequence[Rate], shares: Sequence[float]) -> Rate:
    """The system failure probability over several scenarios (Def. 4.12, Eq. 4.10).

    The limits' distances from the values add up like standard deviations (Zou & Donner 2008,
    Statistics in Medicine 27:1693).

    Args:
        rates: of each scenario.
        shares: their occurrence probabilities, which sum to 1.

    Raises:
        ValueError: if the shares do not fit.

    >>> rate = Rate(0.5, Limits(0.4, 0.6, 0.58), tests=100, failures=50)
    >>> combined([rate, rate], [0.5, 0.5]).value
    0.5
    """
    weights = np.asarray(shares, float)
    if len(weights) != len(rates) or (weights < 0).any() or abs(weights.sum() - 1) > 1e-6:
        raise ValueError(
            f"expected a share for each of {len(rates)} scenarios, together 1,"
            f" got {weights.tolist()}"
        )
    values = np.array([rate.value for rate in rates])
    reach = []
    for name in ("low", "high", "below"):
        limits_of = np.array([getattr(rate.limits, name) for rate in rates])
        reach.append(float(np.sqrt(np.sum((weights * (limits_of - values)) ** 2))))
    value = min(1.0, float(weights @ values))  # Rounded shares may sum to a little more than 1.
    limits = Limits(
        max(0.0, value - reach[0]), min(1.0, value + reach[1]), min(1.0, value + reach[2])
    )
    return Rate(
        value,
        limits,
        tests=sum(rate.tests for rate in rates),
        failures=sum(rate.failures for rate in rates),
        errors=sum(rate.errors for rate in rates),
        note="; ".join(dict.fromkeys(rate.note for rate in rates if rate.note)),
    )


def sentence(rate: Rate, exposure: str) -> str:
    """What a rate allows us to claim, in words; exposure: its name."""
    if rate.limits.below >= 1:
        return (
            f"no claim: these {rate.tests:,} tests say too little about exposure '{exposure}';"
            " execute tests of that exposure"
        )
    limit = one_in(rate.limits.below)
    return f"95 % sure: below {limit} under exposure '{exposure}', after {rate.tests:,} tests"


def one_in(share: float) -> str:
    """A share as `1 in 1,000`; above 1 in 10 in percent.

    It is rounded to two digits towards the larger share.

    >>> one_in(0.00123), one_in(0.25)
    ('1 in 810', '25 %')
    """
    if share > 0.1:
        return f"{np.ceil(share * 1000 - 1e-9) / 10:g} %"
    times = 1 / share * (1 + 1e-9)
    unit = 10 ** max(0, floor(log10(times)) - 1)
    return f"1 in {floor(times / unit) * unit:,}"
