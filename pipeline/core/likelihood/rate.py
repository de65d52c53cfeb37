"""A failure rate with its intervals, and the sentence that says what it allows us to claim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10

import numpy as np
from scipy import optimize, special, stats

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
    """A failure rate in [0, 1] with its limits. tests, failures: executed without an error; errors: in no rate. note: what a reader must
    know beside the number; empty if nothing."""

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

    They hold for a number of independent tests that was fixed before. With no failure in n tests, `below` is 1 - 0.05^(1/n).
    """
    counted = Counted(tests, failures)
    return Limits(*counted.interval(CONFIDENCE), below=counted.interval(1 - 4 * TAIL)[1])


def evidence(failures: int, tests: int, rate: float, above: bool) -> float:
    """Logarithm of the evidence that the true rate lies above `rate`, in (0, 1), or below it: the likelihood averaged over all rates there,
    relative to that of `rate`.

    If the true rate is `rate`, or lies on its other side, the evidence ever exceeds log(1/α) with a probability of at most α, however often
    a person looks (Robbins 1970; Ville's inequality).
    """
    seen = (failures + 1, tests - failures + 1)
    share = (
        special.betaincc(*seen, rate) / (1 - rate) if above else special.betainc(*seen, rate) / rate
    )
    with np.errstate(divide="ignore"):
        return float(
            np.log(share)
            - special.xlogy(failures, rate)
            - special.xlog1py(tests - failures, -rate)
            + special.betaln(*seen)
        )


def anytime(failures: int, tests: int) -> Limits:
    """Limits of a binomial proportion that hold at every moment at once; wider than `exact`, see `evidence`."""
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
    """Limits of an estimate above 0 that rests on the equivalent of `effective` independent failures, above 0.

    The relative error is 1 / sqrt(effective); Student's t on the logarithm, because such estimates are skewed and never negative.
    """
    error, freedom = 1 / np.sqrt(effective), max(effective - 1, 1.0)
    reach, one_sided = (float(stats.t.ppf(1 - tail, freedom)) * error for tail in (TAIL, 2 * TAIL))
    return Limits(*(float(min(1.0, value * np.exp(by))) for by in (-reach, reach, one_sided)))


def bounded(weights: Floats, largest: float, tests: float) -> Limits:
    """Limits of a mean of weighted failures that hold whatever bounded weights the unseen failures have.

    weights: (f,) of the failures. largest: bound of any weight. tests: the weight of all tests, their number if weights are 1 on average. A
    gamma distribution with the weighted sum's variance, shifted by one failure of the largest weight; with equal weights, exact for a
    Poisson count. Source: Fay & Feuer 1997, Statistics in Medicine 16:791.
    """
    value, variance, most = (
        float(weights.sum()) / tests,
        float(weights @ weights) / tests**2,
        largest / tests,
    )

    def quantile(share: float, mean: float, spread: float) -> float:
        return float(min(1.0, spread / (2 * mean) * stats.chi2.ppf(share, 2 * mean**2 / spread)))

    low = quantile(TAIL, value, variance) if value > 0 else 0.0
    high, below = (
        quantile(1 - tail, value + most, variance + most**2) for tail in (TAIL, 2 * TAIL)
    )
    return Limits(low, high, below)


def combined(rates: Sequence[Rate], shares: Sequence[float]) -> Rate:
    """The system failure probability of scenarios with occurrence probabilities that sum to 1 (Def. 4.12, Eq. 4.10).

    The limits' distances from the values add up like standard deviations (Zou & Donner 2008, Statistics in Medicine 27:1693).
    """
    weights = np.asarray(shares, float)
    if len(weights) != len(rates) or (weights < 0).any() or abs(weights.sum() - 1) > 1e-6:
        raise ValueError(
            f"expected a share for each of {len(rates)} scenarios, together 1, got {weights.tolist()}"
        )
    values = np.array([rate.value for rate in rates])
    reach = [
        float(
            np.sqrt(
                np.sum(
                    (weights * (np.array([getattr(rate.limits, name) for rate in rates]) - values))
                    ** 2
                )
            )
        )
        for name in ("low", "high", "below")
    ]
    value = min(1.0, float(weights @ values))  # Rounded shares may sum to a little more than 1.
    limits = Limits(
        max(0.0, value - reach[0]), min(1.0, value + reach[1]), min(1.0, value + reach[2])
    )
    notes = "; ".join(dict.fromkeys(rate.note for rate in rates if rate.note))
    tests, failures, errors = (
        sum(counts)
        for counts in zip(*((one.tests, one.failures, one.errors) for one in rates), strict=True)
    )
    return Rate(value, limits, tests, failures, errors, notes)


def sentence(rate: Rate, exposure: str) -> str:
    """What a rate allows us to claim, in words."""
    if rate.limits.below >= 1:
        return f"no claim: these {rate.tests:,} tests say too little about exposure '{exposure}'; execute tests of that exposure"
    return f"95 % sure: below {one_in(rate.limits.below)} under exposure '{exposure}', after {rate.tests:,} tests"


def one_in(share: float) -> str:
    """A share as `1 in 1,000`, rounded to two digits towards the larger share; a share above 1 in 10 in percent."""
    if share > 0.1:
        return f"{np.ceil(share * 1000 - 1e-9) / 10:g} %"
    times = 1 / share * (1 + 1e-9)
    unit = 10 ** max(0, floor(log10(times)) - 1)
    return f"1 in {floor(times / unit) * unit:,}"
