"""Intervals and tests for counts of failures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def _distributions() -> Any:
    """SciPy's, imported late: that takes most of a second, and planning a study needs none of them."""
    from scipy import stats

    return stats


@dataclass(frozen=True)
class Paired:
    """Failures of two model versions on the same tests, and the exact McNemar test of their difference.

    both, regressions, fixes, neither: number of tests that fail before and after, only after, only before, never. p_value: two-sided, in
    [0, 1]; the probability of a split of the discordant tests at least this uneven if both versions were equal.
    """

    both: int
    regressions: int
    fixes: int
    neither: int
    p_value: float

    @property
    def tests(self) -> int:
        return self.both + self.regressions + self.fixes + self.neither

    @property
    def change(self) -> int:
        """Failures after minus failures before."""
        return self.regressions - self.fixes


def wilson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a proportion, within [0, 1]; (0, 1) for no trials. Source: Wilson 1927."""
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


def mean_interval(values: ArrayLike, confidence: float = 0.95, limits: tuple[float, float] = (-np.inf, np.inf)) -> tuple[float, float]:
    """Student's t interval of the mean of (n,) finite values, one per seed. limits: possible range of the mean.

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
    half = float(_distributions().t.ppf((1 + confidence) / 2, len(sample) - 1) * sample.std(ddof=1) / np.sqrt(len(sample)))
    return max(mean - half, limits[0]), min(mean + half, limits[1])


def mcnemar(before: ArrayLike, after: ArrayLike) -> Paired:
    """Compare two versions on the same tests: (n,) failures of each, in the same order (exact McNemar test)."""
    first, second = np.asarray(before, dtype=bool), np.asarray(after, dtype=bool)
    if first.shape != second.shape or first.ndim != 1:
        raise ValueError(f"before and after must be lists of equal length, got shapes {first.shape} and {second.shape}")
    regressions, fixes = int(np.sum(~first & second)), int(np.sum(first & ~second))
    return Paired(int(np.sum(first & second)), regressions, fixes, int(np.sum(~first & ~second)), mcnemar_p_value(fixes, regressions))


def mcnemar_p_value(fixes: int, regressions: int) -> float:
    """Two-sided p-value of the exact McNemar test, from the numbers of tests that only one and only the other version fails."""
    discordant = fixes + regressions
    return float(_distributions().binomtest(fixes, discordant).pvalue) if discordant else 1.0


def sign_flip(differences: ArrayLike) -> float:
    """Exact two-sided p-value of (n,) whole differences, one per test: how often their sum is at least as far from 0 if each sign is
    equally likely (Fisher's randomisation test). For two versions, with differences -1, 0 and 1, it equals the exact McNemar test."""
    values = np.asarray(differences)
    if values.ndim != 1 or not np.issubdtype(values.dtype, np.integer):
        raise ValueError(f"differences must be a list of whole numbers, got shape {values.shape} of {values.dtype}")
    sizes = np.abs(values[values != 0])
    reach = int(sizes.sum())
    chance = np.zeros(2 * reach + 1)  # The probability of each sum, from -reach to reach.
    chance[reach] = 1.0
    for size in sizes:
        chance = (np.roll(chance, size) + np.roll(chance, -size)) / 2
    far = np.abs(np.arange(-reach, reach + 1)) >= abs(int(values.sum()))
    return min(1.0, float(chance[far].sum()))


def _check_confidence(confidence: float) -> None:
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be in (0, 1), got {confidence}")
