"""Intervals and tests for counts of failures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri, stdtrit

TOLERANCE = 1e-9
"""Rounding errors of sums that count as equal."""


@dataclass(frozen=True)
class Paired:
    """Two model versions on the same tests.

    fixes: tests that only the first version fails. regressions: tests that only the second fails.
    p_value: of the exact McNemar test, see `mcnemar_p_value`.
    """

    fixes: int
    regressions: int
    p_value: float


def wilson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a proportion (Wilson 1927).

    It holds for independent trials of equal probability, such as random tests; not for tests that
    a strategy chose by earlier results, nor for a covering array.

    Args:
        successes: in [0, trials].
        trials: from 0.
        confidence: in (0, 1).

    Returns:
        Lower and upper limit, in [0, 1]; (0, 1) without trials.

    Raises:
        ValueError: successes or confidence out of range.

    >>> low, high = wilson_interval(5, 10)
    >>> round(low, 3), round(high, 3)
    (0.237, 0.763)
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"successes must be in [0, {trials}], got {successes}")
    _check_confidence(confidence)
    if trials == 0:
        return 0.0, 1.0
    z2 = float(ndtri((1 + confidence) / 2)) ** 2
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
    """Student's t interval of a mean over seeds.

    For two or three seeds it is wide: resampling so few would give little more than the smallest
    and the largest value. A single seed says nothing about the spread, so show n beside the
    interval.

    Args:
        values: (n,) finite numbers, one a seed, n from 1.
        confidence: in (0, 1).
        limits: possible range of the mean.
        least_spread: smallest standard deviation to assume.

    Returns:
        Lower and upper limit; (value, value) for a single value.

    Raises:
        ValueError: no values, values that are not finite, or confidence out of range.

    >>> low, high = mean_interval([1.0, 2.0, 3.0])
    >>> round(low, 2), round(high, 2)
    (-0.48, 4.48)
    """
    sample = np.asarray(values, dtype=float)
    if sample.ndim != 1 or not len(sample) or not np.isfinite(sample).all():
        raise ValueError(f"values must be one or more finite numbers, got {sample}")
    _check_confidence(confidence)
    mean = float(sample.mean())
    if len(sample) == 1:
        return mean, mean
    spread = max(sample.std(ddof=1), least_spread)
    quantile = stdtrit(len(sample) - 1, (1 + confidence) / 2)
    half = float(quantile * spread / np.sqrt(len(sample)))
    return max(mean - half, limits[0]), min(mean + half, limits[1])


@dataclass(frozen=True)
class CensoredMean:
    """A mean over campaigns and the limits of its interval.

    censored: number of values that are only known to be larger than observed.
    """

    value: float
    low: float
    high: float
    censored: int


def censored_mean(
    values: ArrayLike, reached: ArrayLike, confidence: float = 0.95, least: float = 0.0
) -> CensoredMean:
    """Mean of values of which some are right-censored: the true ones are larger.

    Dropping censored values would favour a strategy that fails to find anything in its bad
    campaigns. So the mean is the area under the Kaplan-Meier curve, up to the largest value
    (Kaplan & Meier 1958, section 6.1). The interval is Student's over the jackknife's
    pseudo-values (Andersen, Klein & Rosthøj 2003). Without censoring, the result is the plain mean
    with `mean_interval`. The estimate assumes that a censored value is no different from the
    others that got as far.

    Args:
        values: (n,) finite numbers from 0, one a seed, n from 1.
        reached: (n,) whether a value is exact; else it is censored.
        confidence: in (0, 1).
        least: lower limit of the mean. With a censored value, the largest one is its upper limit.

    Returns:
        The mean and its interval. If all values are censored, the largest of them, without an
        interval. If all pseudo-values are equal, both limits are the estimate.

    Raises:
        ValueError: values and flags do not match, or confidence is out of range.

    >>> mean = censored_mean([10, 30, 50], [True, True, False])
    >>> round(mean.value, 3), mean.censored
    (30.0, 1)
    """
    sample, exact = np.asarray(values, dtype=float), np.asarray(reached, dtype=bool)
    is_list = sample.shape == exact.shape and sample.ndim == 1 and len(sample) > 0
    if not is_list or not np.isfinite(sample).all() or (sample < 0).any():
        raise ValueError(
            "values must be one or more finite numbers from 0 and as many flags, "
            f"got {sample} and {exact}"
        )
    count, limit = len(sample), float(sample.max())
    mean = _area(sample, exact, limit)
    without = np.zeros(count)
    for i in range(count if count > 1 else 0):
        without[i] = _area(np.delete(sample, i), np.delete(exact, i), limit)
    low, high = mean, mean
    if exact.any():
        pseudo_values = count * mean - (count - 1) * without
        limits = (least, np.inf if exact.all() else limit)
        low, high = mean_interval(pseudo_values, confidence, limits)
    return CensoredMean(mean, low, high, int((~exact).sum()))


def _area(values: NDArray[np.float64], exact: NDArray[np.bool_], limit: float) -> float:
    """Area under the Kaplan-Meier curve from 0 to a limit that no value exceeds."""
    from scipy import stats  # Imported late: that takes most of a second.

    curve = stats.ecdf(stats.CensoredData(uncensored=values[exact], right=values[~exact])).sf
    return float(np.diff([0.0, *curve.quantiles, limit]) @ [1.0, *curve.probabilities])


def mcnemar(before: ArrayLike, after: ArrayLike) -> Paired:
    """Compare two versions on the same tests by the exact McNemar test.

    Args:
        before: (n,) whether the first version fails each test.
        after: (n,) whether the second version fails it.

    Raises:
        ValueError: the lists have different lengths.

    >>> mcnemar([True, True, True, False], [False, False, False, False])
    Paired(fixes=3, regressions=0, p_value=0.25)
    """
    first, second = np.asarray(before, dtype=bool), np.asarray(after, dtype=bool)
    if first.shape != second.shape or first.ndim != 1:
        raise ValueError(
            "before and after must be lists of equal length, "
            f"got shapes {first.shape} and {second.shape}"
        )
    fixes, regressions = int(np.sum(first & ~second)), int(np.sum(~first & second))
    return Paired(fixes, regressions, mcnemar_p_value(fixes, regressions))


def mcnemar_p_value(fixes: int, regressions: int) -> float:
    """Two-sided p-value of the exact McNemar test.

    Args:
        fixes: number of tests that only the first version fails.
        regressions: number of tests that only the second version fails.

    Returns:
        Probability of a split at least this uneven if both versions were equal, in [0, 1].

    >>> mcnemar_p_value(5, 0)
    0.0625
    """
    from scipy import stats  # Imported late: that takes most of a second.

    discordant = fixes + regressions
    return float(stats.binomtest(fixes, discordant).pvalue) if discordant else 1.0


def holm(p_values: Sequence[float], alpha: float) -> list[bool]:
    """Which hypotheses are rejected, corrected for their number (Holm 1979).

    Args:
        p_values: of each hypothesis, in [0, 1].
        alpha: largest chance that any true hypothesis is rejected.

    >>> holm([0.04, 0.01, 0.03], alpha=0.05)
    [False, True, False]
    """
    rejected, order = [False] * len(p_values), np.argsort(p_values, kind="stable")
    for rank, index in enumerate(order):
        if p_values[index] > alpha / (len(p_values) - rank):
            break
        rejected[index] = True
    return rejected


def paired_rise_limit(regressions: int, fixes: int, tests: int, confidence: float) -> float:
    """Upper confidence limit of the rise of a failure rate between two versions.

    It is the largest rise that Tango's score test does not reject at 1 - confidence. Without
    regressions and fixes, it is z² / (tests + z²). Source: Tango 1998, Statistics in Medicine
    17:891.

    Args:
        regressions: number of tests that only the second version fails.
        fixes: number of tests that only the first version fails.
        tests: number of tests, the same for both versions.
        confidence: one-sided, in (0, 1).

    Returns:
        The limit as a share of tests, in [-1, 1]; 1 without tests.

    Raises:
        ValueError: counts or confidence out of range.

    >>> round(paired_rise_limit(0, 0, 100, 0.95), 4)
    0.0263
    """
    if min(regressions, fixes) < 0 or regressions + fixes > tests:
        raise ValueError(
            f"regressions and fixes must be counts among {tests} tests, "
            f"got {regressions} and {fixes}"
        )
    _check_confidence(confidence)
    if tests == 0:
        return 1.0
    z = float(ndtri(confidence))
    low, high = -1.0, 1.0
    # The score falls as the rise grows. 60 halvings leave an interval of less than 1e-17.
    for _ in range(60):
        rise = (low + high) / 2
        deviation = _rise_deviation(regressions, fixes, tests, rise)
        if regressions - fixes - tests * rise >= -z * deviation:
            low = rise
        else:
            high = rise
    return high


def _rise_deviation(regressions: int, fixes: int, tests: int, rise: float) -> float:
    """Deviation of regressions minus fixes for a true rise and the most likely share of fixes."""
    b = (2 * tests - regressions + fixes) * rise - regressions - fixes
    c = -fixes * rise * (1 - rise)
    # Rounding can take a root of zero below it.
    share = (np.sqrt(max(0.0, b**2 - 8 * tests * c)) - b) / (4 * tests)
    return float(np.sqrt(max(0.0, tests * (2 * share + rise * (1 - rise)))))


def sign_flip(differences: ArrayLike) -> float:
    """Exact two-sided p-value of Fisher's randomisation test on differences.

    For two versions, with differences -1, 0 and 1, it equals the exact McNemar test.

    Args:
        differences: (n,) whole numbers, one a test.

    Returns:
        How often their sum is at least as far from 0 if each sign is equally likely, in [0, 1].

    Raises:
        ValueError: the differences are no list of whole numbers.

    >>> sign_flip([1, 1, 1, 0, -1])
    0.625
    """
    values = np.asarray(differences)
    if values.ndim != 1 or not np.issubdtype(values.dtype, np.integer):
        raise ValueError(
            "differences must be a list of whole numbers, "
            f"got shape {values.shape} of {values.dtype}"
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
    """Exact two-sided p-value of one version against several others on the same tests.

    If all versions are alike, the failures of a test fall on any of them with equal chances
    (Fisher's randomisation test). The statistic is the distance of the version's number of
    failures from the expected one. For one other version, it equals the exact McNemar test.

    Args:
        failed: (n,) whether the version fails each test.
        others: (n,) number of the other versions that fail it, in [0, size].
        size: number of other versions.

    Returns:
        The p-value, in [0, 1].

    Raises:
        ValueError: the lists do not match, or a count is out of range.

    >>> one_against_several([True, True, True], [0, 0, 0], 2)
    0.037037037037037035
    """
    first, counts = np.asarray(failed, dtype=bool), np.asarray(others)
    if first.shape != counts.shape or first.ndim != 1 or ((counts < 0) | (counts > size)).any():
        raise ValueError(
            f"failed and others must be lists of equal length, with counts in [0, {size}], "
            f"got {first} and {counts}"
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
