"""A few sentences about a failure region: conditions, sight and detection, effect of changes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from enum import Enum

from pipeline.artefacts.region_results import Repair, RuleCondition, Seen
from pipeline.scenarios import people

NOUNS = {"child": "children", "adult": "adults"}
WITHOUT = {"hat = 0": "without a hat", "bag = 0": "without a bag", "skirt = 0": "without a skirt"}
WORDS = {word.text: word for word in people.WORDS}
POSES = {word.value: word.text for word in people.WORDS if word.variable == people.POSE}
NAMED = 2
"""Single changes that the text names."""


class Part(Enum):
    """The parts of a phrase about people, in their order.

    Crouching | children | (W 37) | at most 1.3 m tall | in a skirt | with fog.
    """

    POSE, NOUN, NAMES, HEIGHT, LOOKS, OTHER = range(6)


def sentence(
    conditions: Sequence[RuleCondition],
    seen: Seen,
    repairs: Sequence[Repair],
    control: Repair | None,
) -> str:
    """The sentences as one text.

    Args:
        conditions: Conditions of the region's rule.
        seen: When the pedestrian comes into sight and is detected.
        repairs: Effects of single changes, the largest first.
        control: Effect of other noise.
    """
    text = f"{subject(conditions)} {_seen(seen)}"
    return f"{text} {_repairs(repairs, control)}" if repairs else text


def subject(conditions: Sequence[RuleCondition]) -> str:
    """The people and the conditions of a rule.

    Example: `Crouching children with rain of at least 40 %`; without conditions `People in every
    test`.
    """
    if not conditions:
        return "People in every test"
    parts: dict[Part, list[str]] = {part: [] for part in Part}
    for condition in conditions:
        part, text = _part(condition.text)
        parts[part].append(text)
    # The conditions may list people, such as `blueprint = M 34`, and all of them may be children.
    listed = [set(c.values) for c in conditions if c.variable == people.VARIABLE]
    admitted = set.intersection(*listed) if listed else set()
    children = bool(listed) and all(people.person(name).child for name in admitted)
    noun = parts[Part.NOUN] or ["children" if children else "people"]
    words = [*parts[Part.POSE], *noun]
    for part in (Part.NAMES, Part.HEIGHT, Part.LOOKS):
        words += parts[part]
    if parts[Part.OTHER]:
        words.append(f"with {_listed(parts[Part.OTHER], 'and')}")
    phrase = " ".join(words)
    return f"{phrase[0].upper()}{phrase[1:]}"


def _part(condition: str) -> tuple[Part, str]:
    """The part of the phrase that a condition makes, and its words."""
    if condition in NOUNS:
        return Part.NOUN, NOUNS[condition]
    if condition in WORDS:
        return Part.POSE if WORDS[condition].variable == people.POSE else Part.LOOKS, condition
    if condition in WITHOUT:
        return Part.LOOKS, WITHOUT[condition]
    about, words = plain(condition).split(" ", 1)
    if about == people.VARIABLE:
        return Part.NAMES, f"({words})"
    if about == people.POSE:
        return Part.POSE, re.sub(r"\w+", lambda pose: POSES.get(pose[0], pose[0]), words)
    if about == "height":
        return Part.HEIGHT, f"{words.removeprefix('of ').removeprefix('from ')} tall"
    return Part.OTHER, f"{about} {words}"


def plain(condition: str) -> str:
    """A condition of a rule without signs: `rain of at least 40 %` for `rain >= 40 %`."""
    # An attribute in metres, such as height_m.
    text = re.sub(r"^(\w+)_m (.+)$", r"\1 \2 m", condition)
    text = text.replace("_", " ").replace(" >= ", " of at least ").replace(" <= ", " of at most ")
    text = re.sub(r" in \[(.+?), (.+?)\]", r" from \1 to \2", text)
    if listed := re.match(r"(.+) in \{(.+)\}", text):
        return f"{listed[1]} {_listed(listed[2].split(', '), 'or')}"
    return text.replace(" = ", " ")


def _seen(seen: Seen) -> str:
    """When the pedestrians come into sight and are first detected."""
    if not seen.in_sight:
        return f"are never in sight ({seen.failures} failures)."
    if seen.delay_s is None or seen.first_detection_m is None:
        unseen = f", except for {seen.detected} never in sight" if seen.detected else ""
        return (
            f"come into sight {seen.first_sight_m or 0:.0f} m before the conflict point and are "
            f"never detected{unseen} (median of {seen.in_sight} failures)."
        )
    delay = "as soon as they come into sight"
    if seen.delay_s >= 0.05:
        delay = f"{seen.delay_s:.1f} s after they come into sight"
    never = ""
    if missed := seen.failures - seen.detected:
        never = f"; {missed} {'is' if missed == 1 else 'are'} never detected"
    return (
        f"are first detected {delay}, {seen.first_detection_m:.0f} m before the conflict point. "
        f"Medians of {seen.failures} failures{never}."
    )


def _repairs(repairs: Sequence[Repair], control: Repair | None) -> str:
    """The best single changes, and clear weather as a whole if it has a larger effect."""
    named = [repair for repair in repairs if len(repair.values) < 2 and repair.repaired][:NAMED]
    most = max((repair.repaired for repair in named), default=0)
    named += [repair for repair in repairs if len(repair.values) > 1 and repair.repaired > most]
    shares = []
    for repair in [*named, *([control] if control else [])]:
        shares.append(f"{repair.change} {repair.repaired} of {repair.tests}")
    if named:
        return f"Repairs: {', '.join(shares)}."
    tests = max(repair.tests for repair in repairs)
    clauses = [f"No single change repairs any of {tests}", *shares]
    return f"{', '.join(clauses)}."


def _listed(parts: Sequence[str], last: str) -> str:
    """`a, b and c`. last: the word before the last part."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}"
