"""regions/<version>/<scenario>.json: failure regions, their confirmation by fresh tests, and why
their failures fail.
"""

from __future__ import annotations

from typing import Literal

from pipeline.artefacts.failure_counts import Count, Modes
from pipeline.artefacts.results import Estimate, Result

Role = Literal["medoid", "worst", "furthest"]


class Representative(Result):
    """A test that represents a region.

    It is the medoid, the worst failure or the failure furthest from the medoid.
    """

    test_id: str
    role: Role
    strategy: str
    seed: int
    adj_ttc_s: float
    concrete: dict[str, float | str]


class RuleCondition(Result):
    """A condition of a rule for programs.

    Attributes:
        low, high: in the variable's unit, for a numeric variable; low > high wraps around the end
            of a cyclic one.
        values: that a categorical variable may have.
        text: as it stands in the rule.
    """

    variable: str
    text: str
    low: float | None = None
    high: float | None = None
    values: tuple[str, ...] = ()


class Fresh(Result):
    """Fresh random tests.

    Attributes:
        failures: of the `tests` without an error.
        errors: tests that ended in an error, in neither number.
        rate: failures per test with its exact interval (Clopper-Pearson); null without tests.
    """

    tests: int
    failures: int
    errors: int
    rate: Estimate | None


class Confirmation(Result):
    """Fresh random tests inside and just outside a rule.

    Attributes:
        confidence: of each rate's interval.
        p_value: chance of at least so many failures inside if both failure rates were equal
            (Fisher's exact test, one-sided).
    """

    confidence: float
    inside: Fresh
    outside: Fresh
    p_value: float


class Repair(Result):
    """A single change of a region's failures and what it repairs.

    Attributes:
        change: in words.
        values: new values by variable.
        without: actors that are removed.
        repaired: failures, of `tests`, that pass with the change.
        errors: executions that broke, in neither number.
        rate: repaired per test with its exact interval (Clopper-Pearson); null without tests.
    """

    change: str
    values: dict[str, float | str]
    without: tuple[str, ...]
    tests: int
    repaired: int
    errors: int
    rate: Estimate | None


class Seen(Result):
    """What the camera saw in a region's failures.

    All are medians; null if nothing counts. First sight: over the failures with the pedestrian in
    sight. First detection, and the delay from first sight until then: over those with both. Last
    chance: over those with a last frame from which full braking stops the ego in time. Distances
    are to the conflict point.

    Attributes:
        in_sight, detected: of `failures`, those in which a person could make out the pedestrian,
            and those in which the detector found the pedestrian.
    """

    failures: int
    in_sight: int
    detected: int
    first_sight_m: float | None
    first_sight_pixels: float | None
    first_sight_contrast: float | None
    last_chance_pixels: float | None
    last_chance_contrast: float | None
    first_detection_m: float | None
    delay_s: float | None


class Why(Result):
    """Why a region's failures fail.

    Attributes:
        sentence: all below in plain words.
        confidence: of each rate's interval.
        repairs: single changes, those that repair most first, then clear weather as a whole.
        control: the same with other noise alone. Without executed changes, there are no repairs and
            no control.
    """

    sentence: str
    seen: Seen
    confidence: float
    repairs: tuple[Repair, ...] = ()
    control: Repair | None = None


class FailureRegion(Result):
    """One group of failures with its readable rule.

    Attributes:
        cause: why its failures failed, see `pipeline.core.causes`, or `mixed`.
        support: tests inside the rule.
        failures_inside: those that failed, from whatever cause.
        precision: their ratio. It has no interval: adaptive strategies gather their tests where
            failures are, and the rule is fitted to these tests, so they are no independent samples.
        lift: precision divided by the failure rate of all tests.
        recall: share of the region's members that the rule covers.
        held_back: tests inside rules that are fitted without these tests, each in turn.
        status: a rule is confirmed if fresh random tests inside it fail more often than those just
            outside; the tests that it was found from never confirm it.
        confirmation: these fresh tests, null if none were executed.
        why: what repairs its failures and what the camera saw.
        groups: named groups, such as `children`, to which every test inside the rule belongs.
    """

    name: str
    cause: str
    members: tuple[str, ...]
    modes: Modes
    strategies: dict[str, int]
    rule: str
    conditions: tuple[RuleCondition, ...]
    support: int
    failures_inside: int
    precision: float
    lift: float
    recall: float
    held_back: Count
    status: Literal["confirmed", "not confirmed"] = "not confirmed"
    confirmation: Confirmation | None = None
    why: Why | None = None
    groups: tuple[str, ...] = ()
    representatives: tuple[Representative, ...]


class FailureRegions(Result):
    """Failure regions of one search scenario over all its campaigns.

    `isolated` failures are in none of them.

    Attributes:
        connected: number of connected failure sets on the categories (Def. 4.19).
        not_solvable: failures that no detector could avoid with this camera: full braking from the
            first frame in which a person could see the pedestrian would have come too late.
    """

    scenario: str
    label: str
    tests: int
    failures: int
    failure_rate: float
    connected: int
    regions: tuple[FailureRegion, ...]
    isolated: tuple[str, ...]
    not_solvable: tuple[str, ...]
