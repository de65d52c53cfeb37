"""Intervals and tests for counts of failures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

TOLERANCE = 1e-9
"""Rounding errors of sums that count as equal."""


def _distributions() -> Any:
    """SciPy's, imported late: that takes most of a second, and planning a study needs none of them."""
    from scipy import stats

    return stats


@dataclass(frozen=True)
class Paired:
    """Two model versions on the same tests: `fixes` fail only before, `regressions` only after. p_value: see `mcnemar_p_value`."""

    fixes: int
    regressions: int
    p_value: float


def wilson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a proportion, within [0, 1]; (0, 1) for no trials. Source: Wilson 1927.

    It holds for independent trials of equal probability, such as random tests; not for tests that a strategy chose by earlier results, nor
    for a covering array.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"successes must be in [0, {trials}], got {successes}")
    _check_confidence(confidence)
    if trials == 0:
        return 0.0, 1.0
    z2 = float(_distributions().norm.ppf((1 + confidence) / 2)) ** 2
    share = successes / trials
    centre = (share + z2 / (2 * trials)) / (1 + z2 / trials)
    half = np.sqrt(z2 * (share * (1 - share) / trials + z2 / (4 * trials**2))) / (1 + z2 / trials)
    # The exact bounds there are 0 and 1; floating point misses them by an ulp.
    low = 0.0 if successes == 0 else float(centre - half)
    high = 1.0 if successes == trials else float(centre + half)
    return low, high


def mean_interval(
    values: ArrayLike,
    confidence: float = 0.95,
    limits: tuple[float, float] = (-np.inf, np.inf),
    least_spread: float = 0.0,
) -> tuple[float, float]:
    """Student's t interval of the mean of (n,) finite values, one per seed. limits: possible range of the mean. least_spread: the smallest
    standard deviation to believe.

    For two or three seeds it is wide: resampling so few would give little more than the smallest and the largest value. A single value
    gives (value, value): one seed says nothing about the spread, so show n beside the interval.
    """
    sample = np.asarray(values, dtype=float)
    if sample.ndim != 1 or not len(sample) or not np.isfinite(sample).all():
        raise ValueError(f"values must be one or more finite numbers, got {sample}")
    _check_confidence(confidence)
    mean = float(sample.mean())
    if len(sample) == 1:
        return mean, mean
    spread = max(sample.std(ddof=1), least_spread)
    half = float(
        _distributions().t.ppf((1 + confidence) / 2, len(sample) - 1)
        * spread
        / np.sqrt(len(sample))
    )
    return max(mean - half, limits[0]), min(mean + half, limits[1])


@dataclass(frozen=True)
class CensoredMean:
    """A mean over campaigns and the limits of its interval; `censored` of their values are only known to be larger than observed."""

    value: float
    low: float
    high: float
    censored: int


def censored_mean(
    values: ArrayLike, reached: ArrayLike, confidence: float = 0.95, least: float = 0.0
) -> CensoredMean:
    """Mean of (n,) values at least 0, one per seed, restricted to the largest of them (Kaplan & Meier 1958, section 6.1).

    reached: (n,) whether a value is exact; if not, it is right-censored: the true one is larger. Dropping censored values would favour a
    strategy that fails to find anything in its bad campaigns. The interval is Student's over the jackknife's pseudo-values (Andersen, Klein
    & Rosthøj 2003); without censoring they are the values, and the result is the plain mean with `mean_interval`. least: lower limit of the
    mean; with a censored value, the largest one is its upper limit. If all values are censored, the estimate is the largest of them, as a
    lower bound, without an interval. If all pseudo-values are equal, both limits are the estimate.

    The estimate assumes that a censored value is no different from the others that got as far.
    """
    sample, exact = np.asarray(values, dtype=float), np.asarray(reached, dtype=bool)
    if (
        sample.shape != exact.shape
        or sample.ndim != 1
        or not len(sample)
        or not np.isfinite(sample).all()
        or (sample < 0).any()
    ):
        raise ValueError(
            f"values must be one or more finite numbers from 0 and as many flags, got {sample} and {exact}"
        )
    count, limit = len(sample), float(sample.max())
    mean = _area(sample, exact, limit)
    without = (
        np.array([_area(np.delete(sample, i), np.delete(exact, i), limit) for i in range(count)])
        if count > 1
        else np.zeros(1)
    )
    highest = np.inf if exact.all() else limit
    low, high = (
        mean_interval(count * mean - (count - 1) * without, confidence, (least, highest))
        if exact.any()
        else (mean, mean)
    )
    return CensoredMean(mean, low, high, int((~exact).sum()))


def _area(values: NDArray[np.float64], exact: NDArray[np.bool_], limit: float) -> float:
    """Area under the Kaplan-Meier curve from 0 to a limit that no value exceeds."""
    stats = _distributions()
    curve = stats.ecdf(stats.CensoredData(uncensored=values[exact], right=values[~exact])).sf
    return float(np.diff([0.0, *curve.quantiles, limit]) @ [1.0, *curve.probabilities])


def mcnemar(before: ArrayLike, after: ArrayLike) -> Paired:
    """Compare two versions on the same tests: (n,) failures of each, in the same order (exact McNemar test)."""
    first, second = np.asarray(before, dtype=bool), np.asarray(after, dtype=bool)
    if first.shape != second.shape or first.ndim != 1:
        raise ValueError(
            f"before and after must be lists of equal length, got shapes {first.shape} and {second.shape}"
        )
    fixes, regressions = int(np.sum(first & ~second)), int(np.sum(~first & second))
    return Paired(fixes, regressions, mcnemar_p_value(fixes, regressions))


def mcnemar_p_value(fixes: int, regressions: int) -> float:
    """Two-sided p-value of the exact McNemar test, in [0, 1]: the probability of a split at least this uneven if both versions were equal.

    fixes, regressions: number of tests that only one, and only the other version fails.
    """
    discordant = fixes + regressions
    return float(_distributions().binomtest(fixes, discordant).pvalue) if discordant else 1.0


def paired_rise_limit(regressions: int, fixes: int, tests: int, confidence: float) -> float:
    """One-sided upper confidence limit of the rise of a failure rate between two versions on the same tests, in [-1, 1]; 1 without tests.

    regressions, fixes: number of tests that only the second, and only the first version fails. It is the largest rise that Tango's score
    test does not reject at 1 - confidence. Without regressions and fixes, it is z² / (tests + z²). Source: Tango 1998, Statistics in
    Medicine 17:891.
    """
    if min(regressions, fixes) < 0 or regressions + fixes > tests:
        raise ValueError(
            f"regressions and fixes must be counts among {tests} tests, got {regressions} and {fixes}"
        )
    _check_confidence(confidence)
    if tests == 0:
        return 1.0
    z = float(_distributions().norm.ppf(confidence))
    low, high = -1.0, 1.0
    # The score falls as the rise grows. 60 halvings leave an interval of less than 1e-17.
    for _ in range(60):
        rise = (low + high) / 2
        if regressions - fixes - tests * rise >= -z * _rise_deviation(
            regressions, fixes, tests, rise
        ):
            low = rise
        else:
            high = rise
    return high


def _rise_deviation(regressions: int, fixes: int, tests: int, rise: float) -> float:
    """Standard deviation of regressions minus fixes if the true rise is `rise`, with the most likely share of fixes (Tango 1998)."""
    b = (2 * tests - regressions + fixes) * rise - regressions - fixes
    c = -fixes * rise * (1 - rise)
    # Rounding can take a root of zero below it.
    share = (np.sqrt(max(0.0, b**2 - 8 * tests * c)) - b) / (4 * tests)
    return float(np.sqrt(max(0.0, tests * (2 * share + rise * (1 - rise)))))


def sign_flip(differences: ArrayLike) -> float:
    """Exact two-sided p-value of (n,) whole differences, one per test: how often their sum is at least as far from 0 if each sign is
    equally likely (Fisher's randomisation test). For two versions, with differences -1, 0 and 1, it equals the exact McNemar test."""
    values = np.asarray(differences)
    if values.ndim != 1 or not np.issubdtype(values.dtype, np.integer):
        raise ValueError(
            f"differences must be a list of whole numbers, got shape {values.shape} of {values.dtype}"
        )
    sizes = np.abs(values[values != 0])
    reach = int(sizes.sum())
    chance = np.zeros(2 * reach + 1)  # The probability of each sum, from -reach to reach.
    chance[reach] = 1.0
    for size in sizes:
        chance = (np.roll(chance, size) + np.roll(chance, -size)) / 2
    far = np.abs(np.arange(-reach, reach + 1)) >= abs(int(values.sum()))
    return min(1.0, float(chance[far].sum()))


def one_against_several(failed: ArrayLike, others: ArrayLike, size: int) -> float:
    """Exact two-sided p-value of one version against `size` others on the same tests, if all of them are alike.

    failed: (n,) bool, of the one. others: (n,) number of the others that fail. Whichever versions fail a test, the one is then any of the
    size + 1 with equal chances (Fisher's randomisation test). The statistic is how far its number of failures is from the expected one. For
    one other version, it equals the exact McNemar test.
    """
    first, counts = np.asarray(failed, dtype=bool), np.asarray(others)
    if first.shape != counts.shape or first.ndim != 1 or ((counts < 0) | (counts > size)).any():
        raise ValueError(
            f"failed and others must be lists of equal length, with counts in [0, {size}], got {first} and {counts}"
        )
    shares = (first + counts) / (size + 1)
    chance = np.ones(1)  # The probability of each number of failures, from 0 on.
    for share in shares:
        chance = np.convolve(chance, [1 - share, share])
    away = np.abs(np.arange(len(chance)) - shares.sum())
    return min(1.0, float(chance[away >= abs(first.sum() - shares.sum()) - TOLERANCE].sum()))


def _check_confidence(confidence: float) -> None:
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be in (0, 1), got {confidence}")
