"""The words of an evidence file: the claim, the assumptions and the limits."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.artefacts.evidence import ScenarioEvidence, Whole
from pipeline.config.exposure import ExposureFile
from pipeline.core.likelihood.rate import one_in

SIMULATED = (
    "The simulator and its camera stand for the road. Nothing here was recorded on a real road."
)
ROAD_USERS = (
    "Each test has at most one pedestrian, and the ego brakes as the settings say; other road "
    "users follow fixed plans."
)
FITTED = "A rule that is not confirmed is judged by the very tests to which it was fitted."
ASSUMPTIONS = (
    SIMULATED,
    ROAD_USERS,
    "A test fails if its adjusted time-to-collision is at most {threshold:g} s or, where the right "
    "answer is not to brake, by any false activation.",
    "The conditions of the road are distributed as the exposure says.",
    "Random tests are independent, and their number was fixed before the first.",
    "Tests that ended in an error would have failed as often as the others.",
)
LIMITS = (
    "A rate is per encounter in that scenario, not per hour or kilometre.",
    "Searches sample near failures. Their tests find regions and count for coverage, but enter no "
    "rate.",
    "Known safe counts only combinations of categories that a passed test covers. Other tests of "
    "the same combination may fail: that risk is part of the unknown unsafe area.",
    FITTED,
    "Each interval holds for its own number, not for all numbers together.",
)
WEIGHED = (
    "Random tests are uniform. They are weighted by the exposure, so a few of them may carry most "
    "of the weight."
)
SEVERAL = (
    "The exposure does not say how often each scenario occurs, so there are no numbers for all "
    "scenarios together."
)
RETRAINED = (
    "Retrained versions of this study have no random tests on these scenarios, so they have no "
    "evidence file here. To get one, test the version on its own: python -m pipeline test-detector."
)


def claim(
    version: str, scenarios: Sequence[ScenarioEvidence], whole: Whole | None, exposure: ExposureFile
) -> str:
    """The claim that the numbers support, in words.

    Args:
        version: The detector's version.
        scenarios: Evidence of each scenario.
        whole: Evidence of all scenarios together, if the exposure supports it.
        exposure: The exposure that the rates refer to.
    """
    if whole is not None and len(scenarios) > 1:
        labels = ", ".join(scenario.domain.label for scenario in scenarios)
        return _sentence(f"Detector {version} in {labels}", whole, exposure)
    sentences = []
    for scenario in scenarios:
        who = f"Detector {version} in {scenario.domain.label}"
        sentences.append(_sentence(who, scenario, exposure))
    return " ".join(sentences)


def _sentence(who: str, evidence: ScenarioEvidence | Whole, exposure: ExposureFile) -> str:
    failure, hidden = evidence.failure, evidence.areas.unknown_unsafe
    if failure.below is None:
        return f"{who}: no claim, because {failure.missing}."
    text = f"{who}: 95 % sure that the failure rate is below {one_in(failure.below)}"
    if hidden.below is not None:
        text += (
            f"; separately, 95 % sure that fewer than {one_in(hidden.below)} of all encounters are "
            "failures outside the searches' rules"
        )
    return f"{text}; {failure.tests:,} random tests; exposure: {exposure.description}."


def assumptions(failure_threshold_s: float) -> tuple[str, ...]:
    """The assumptions. failure_threshold_s: adj. TTC at or below which a test fails."""
    return tuple(text.format(threshold=failure_threshold_s) for text in ASSUMPTIONS)


def limits(whole: Whole | None, exposure: ExposureFile, retrained: bool) -> tuple[str, ...]:
    """The limits of the evidence.

    Args:
        whole: Evidence of all scenarios together, if the exposure supports it.
        exposure: The exposure that the rates refer to.
        retrained: Whether the study has versions without an evidence file.
    """
    texts = [*LIMITS]
    if not exposure.uniform:
        texts.append(WEIGHED)
    if whole is None:
        texts.append(SEVERAL)
    if retrained:
        texts.append(RETRAINED)
    return tuple(texts)
