"""Counts that the results of searches, regions and comparisons share.

They count tests, failures by mode and by cause, and unnecessary braking.
"""

from __future__ import annotations

from pipeline.artefacts.results import Result


class Count(Result):
    """Valid tests, of which `failures` fail."""

    tests: int
    failures: int

    @property
    def rate(self) -> float | None:
        """Failures per test; None without tests."""
        return self.failures / self.tests if self.tests else None


class Modes(Result):
    """Failures by failure mode; `contact + late` fail by TTC alone, `false_positives` only because
    Eq. 5.3 divides by them, and `false_activation` by unnecessary braking.
    """

    contact: int = 0
    late: int = 0
    false_positives: int = 0
    false_activation: int = 0

    @property
    def by_ttc(self) -> int:
        """Failures by TTC alone."""
        return self.contact + self.late

    @property
    def total(self) -> int:
        return self.by_ttc + self.false_positives + self.false_activation


class Causes(Result):
    """Failures by cause, see `pipeline.core.causes`."""

    never_seen: int = 0
    lost_after_detection: int = 0
    too_late: int = 0
    box: int = 0
    confidence: int = 0
    false_positives: int = 0
    not_solvable: int = 0
    false_activation: int = 0

    @property
    def total(self) -> int:
        return sum(count for _, count in self)


class FalseActivations(Result):
    """Unnecessary emergency braking: `number` times in `braking` of `tests` valid tests.

    Attributes:
        duration_s: of all together.
        speed_loss_mps: speed lost by unnecessary braking in these `braking` tests together.
    """

    tests: int = 0
    braking: int = 0
    number: int = 0
    duration_s: float = 0.0
    speed_loss_mps: float = 0.0

    @property
    def mean_duration_s(self) -> float | None:
        """Of a false activation; None if there is none."""
        return self.duration_s / self.number if self.number else None

    @property
    def mean_speed_loss_mps(self) -> float | None:
        """Of a test with a false activation; None if there is none."""
        return self.speed_loss_mps / self.braking if self.braking else None
