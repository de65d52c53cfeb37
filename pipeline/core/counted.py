"""Outcomes of independent tests, and the failure rate that they show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Counted:
    """Counts of independent tests.

    tests: those without an error. failures: of `tests`. errors: tests that ended in an error, in
    neither number.

    >>> Counted.of(np.array([True, False, True]), error=np.array([False, False, True]))
    Counted(tests=2, failures=1, errors=1)
    """

    tests: int
    failures: int
    errors: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.failures <= self.tests or self.errors < 0:
            raise ValueError(
                f"failures must be in [0, {self.tests}] and errors not negative, "
                f"got {self.failures} and {self.errors}"
            )

    @staticmethod
    def of(failed: Bools, error: Bools | None = None) -> Counted:
        """Count (n,) outcomes; `failed` does not matter where `error` holds."""
        errors = np.zeros(len(failed), bool) if error is None else error
        return Counted(int((~errors).sum()), int((failed & ~errors).sum()), int(errors.sum()))

    def interval(self, confidence: float) -> tuple[float, float]:
        """Exact interval of the failure rate, (0, 1) without tests (Clopper & Pearson 1934)."""
        tail, passed = (1 - confidence) / 2, self.tests - self.failures
        low = float(betaincinv(self.failures, passed + 1, tail)) if self.failures else 0.0
        high = float(betaincinv(self.failures + 1, passed, 1 - tail)) if passed else 1.0
        return low, high
