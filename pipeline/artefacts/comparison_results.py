"""comparison.json: every model version on the same frozen sequence of held-out tests."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer

from pipeline.artefacts.results import Estimate, Modes, Result
from pipeline.core.comparison import SequenceTest, Verdict

TestName = Annotated[
    SequenceTest,
    BeforeValidator(lambda test: SequenceTest.named(test) if isinstance(test, str) else test),
    PlainSerializer(str, return_type=str),
]
"""A test of the held-out sequence, in the file by its name."""


class VersionPair(Result):
    """Two versions on the same tests: which of them only one fails, and the exact McNemar p-value."""

    version: str
    against: str
    tests: int
    fixes: tuple[TestName, ...]
    regressions: tuple[TestName, ...]
    p_value: float


class ScenarioResult(Result):
    """One model version on one held-out scenario; `paired` is against the base."""

    tests: int
    failures: int
    rate: Estimate
    paired: VersionPair | None


class VersionResult(Result):
    """One model version on the frozen held-out sequence.

    group: what versions that differ by the seed of retraining alone share; round: of retraining, 0 for the base. tests: valid executions.
    change: regressions minus fixes, of the tests valid for it and the base. scenarios: by scenario.
    """

    version: str
    group: str
    round: int
    tests: int
    errors: int
    failures: int
    modes: Modes
    scenarios: dict[str, ScenarioResult]
    rate: Estimate
    change: int
    paired: VersionPair | None
    verdict: Verdict


class GroupResult(Result):
    """Versions that differ by the seed of retraining alone: mean failures, in all and by scenario, with Student's intervals over the seeds;
    of a single version Wilson's over the tests.

    against_base: ratio of its mean to the base's failures; null where the base fails nowhere.
    """

    group: str
    round: int
    versions: tuple[str, ...]
    failures: Estimate
    scenarios: dict[str, Estimate]
    against_base: float | None


class GroupPair(Result):
    """Two groups on the `tests` that all of their versions executed.

    difference: mean failures of `group` minus those of `against`, with Student's interval over the seeds, paired by seed. p_value: exact
    sign-flip test of the tests' differences, summed over seeds: whether these versions differ on tests like these. With one seed it is the
    exact McNemar test.
    """

    group: str
    against: str
    tests: int
    difference: Estimate
    p_value: float

    def shown(self, alpha: float) -> bool:
        """Whether the tests tell them apart (p at most alpha) and the trainings do so, too: one seed says nothing of these, of several the
        interval must leave 0 out. By the tests alone the luck of three trainings would pass for an effect in up to a fifth of cases.
        """
        return self.p_value <= alpha and not self.difference.low <= 0 <= self.difference.high


class RegionResult(Result):
    """A failure region of the base on the held-out sequence, and how many of the tests inside its rule each version fails."""

    scenario: str
    name: str
    rule: str
    tests: int
    failures: dict[str, int]


class Comparison(Result):
    """All versions on one frozen sequence. In the file a fix or a regression is named `<scenario>-<index>`, five digits.

    pairs: exact McNemar test of every pair of versions, `against` the earlier one; group_pairs: the same for groups.
    """

    strategy: str
    scenarios: dict[str, str]
    sequence_digest: str
    confidence: float
    alpha: float
    versions: tuple[VersionResult, ...]
    groups: tuple[GroupResult, ...]
    group_pairs: tuple[GroupPair, ...]
    pairs: tuple[VersionPair, ...]
    regions: tuple[RegionResult, ...]
    champion: str
    gate: dict[str, str]

    def pair(self, version: str, against: str) -> VersionPair | None:
        """The test of a version against an earlier one; None if there are not both."""
        return next((pair for pair in self.pairs if (pair.version, pair.against) == (version, against)), None)

    def passes(self, version: str) -> bool:
        """Whether a version passed the gate; the base, which is not judged, did not."""
        return self.gate[version].startswith("passes")
