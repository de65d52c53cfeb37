"""evidence/<version>.json: what a study shows about one detector, for a safety case in the terms of
ISO 21448 (SOTIF).
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from pipeline.artefacts.region_results import Confirmation, RuleCondition
from pipeline.artefacts.results import Estimate, Result


class Area(Result):
    """A share of the exposure's probability."""

    share: Estimate | None = Field(
        description="In [0, 1], with its 95 % interval; null if there is no estimate."
    )
    definition: str = Field(description="What belongs to the area.")
    source: str = Field(description="What the share is computed from.")
    missing: str = Field(default="", description="Why there is no estimate; empty if there is one.")


class Risk(Area):
    """The probability of a failure, from random tests alone.

    The tests of any other strategy never enter it.
    """

    below: float | None = Field(
        default=None, description="One-sided upper limit of the share: 95 % sure that it is below."
    )
    tests: int = Field(default=0, description="Random tests without an error.")
    failures: int = Field(default=0, description="Those that count for this share.")
    errors: int = Field(
        default=0, description="Random tests that ended in an error; they are in no share."
    )


class Areas(Result):
    """The areas of the thesis' Figure 8.1.

    `known_unsafe`, `known_safe` and `unknown` add up to 1. The rules of `unknown_unsafe` are fitted
    to the tests of searches alone, so a part of it may lie in `known_unsafe`.
    """

    known_unsafe: Area = Field(description="Conditions inside the rule of a failure region.")
    confirmed: Area = Field(
        description="The part of known_unsafe that fresh random tests confirmed."
    )
    known_safe: Area = Field(
        description="Conditions outside all rules whose combinations were shown by passed tests."
    )
    unknown: Area = Field(
        description="Conditions outside all rules whose combinations were shown by no passed test."
    )
    unknown_unsafe: Risk = Field(description="Probability of a failure outside all rules.")


class Coverage(Result):
    """k-projection coverage by the valid tests of all strategies."""

    k: int
    covered: int = Field(description="Cells with at least one test.")
    required: int = Field(description="Cells that a feasible test reaches.")
    ratio: float
    tests: int


class OpenRegion(Result):
    """A failure region that is still open."""

    name: str
    rule: str
    conditions: tuple[RuleCondition, ...]
    cause: str
    status: Literal["confirmed", "not confirmed"]
    confirmation: Confirmation | None = Field(
        description="Fresh random tests inside and just outside the rule; null without any."
    )
    failures: int = Field(
        description="Failures that belong to the region, of all strategies: no rate."
    )
    worst: str = Field(description="Test id of the worst failure.")
    share: Estimate = Field(description="Share of the exposure's probability inside the rule.")


class Domain(Result):
    """The operational design domain in one functional scenario."""

    scenario: str
    label: str
    description: str
    variables: dict[str, Any] = Field(
        description="Each variable with unit, bounds and categories, as in space/<scenario>.json."
    )
    constraints: tuple[tuple[str, ...], ...] = Field(
        description="Each is a clause, of which a test satisfies one literal, or a single text."
    )


class ScenarioEvidence(Result):
    """What the study shows in one functional scenario."""

    domain: Domain
    coverage: Coverage
    failure: Risk = Field(description="The probability of a failure.")
    areas: Areas
    open_regions: tuple[OpenRegion, ...]
    isolated_failures: int = Field(description="Failures in no region.")


class Whole(Result):
    """All scenarios together, weighted by how often the exposure says that each occurs."""

    shares: dict[str, float]
    failure: Risk
    areas: Areas


class ModelIdentity(Result):
    """The detector under test."""

    version: str
    file: str
    sha256: str
    weights_sha256: str | None = Field(description="Of our own versions.")
    data: dict[str, str] = Field(
        description="Digests of its training data; empty if they are not known."
    )


class Evidence(Result):
    """What a study shows about one detector, in the terms of ISO 21448 (SOTIF)."""

    format: Literal[1] = 1
    study: str
    claim: str
    confidence: float = Field(description="Of every interval.")
    exposure: dict[str, Any] = Field(
        description="The distribution of conditions, with the public source of each."
    )
    scenarios: tuple[ScenarioEvidence, ...]
    whole: Whole | None = Field(
        description="Null if the exposure does not say how often each scenario occurs."
    )
    model: ModelIdentity
    settings_sha256: str = Field(description="Of the settings that this file depends on.")
    files: dict[str, str] = Field(
        description="Path and SHA-256 of every file that this one was made from."
    )
    assumptions: tuple[str, ...]
    limits: tuple[str, ...]
