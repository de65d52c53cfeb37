"""A card for each failure region: its sentence, rule, numbers, pictures, repairs and films. Every number comes from the artefact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import floor

import pandas as pd

from pipeline.artefacts.dataset import decode_jpeg
from pipeline.artefacts.region_results import Confirmation, FailureRegion, FailureRegions, Repair
from pipeline.report.explorer import groups
from pipeline.report.failure_tables import CAUSES, MIXED, NONE
from pipeline.report.formats import percent, share
from pipeline.report.fresh_counts import fresh_counts
from pipeline.report.kept_frames import KeptFrames, Moment
from pipeline.report.page import Bar, Box, Card, Film, Picture
from pipeline.report.replays import jpeg_uri
from pipeline.report.style import MODE_NAMES

PICTURES = 4
"""Pictures on a card, of as many failures."""
BOXES = 4
"""Detections on a picture, best first."""
NOT_EXECUTED = "not executed"


@dataclass(frozen=True)
class Shown:
    """What cards show beside the artefact. moments, ends: of tests, the latter in words. films: by region. reported_from: the lowest score
    that the detector reports."""

    moments: Mapping[str, Moment]
    ends: Mapping[str, str]
    films: Mapping[str, Sequence[Film]]
    reported_from: float


def pictured(found: FailureRegions, frames: KeptFrames) -> dict[str, tuple[str, ...]]:
    """The tests on each card of a scenario: a region's representatives, then its other failures, as far as frames were kept."""
    first = {
        region.name: [one.test_id for one in region.representatives] for region in found.regions
    }
    known = frames.tests
    return {
        name: tuple(
            [test for test in dict.fromkeys([*first.get(name, []), *tests]) if test in known][
                :PICTURES
            ]
        )
        for name, tests in groups(found).items()
    }


def ends(tests: pd.DataFrame) -> dict[str, str]:
    """How each test ended: `contact, adj. TTC 0.02 s`. tests: rows of tests.parquet without an error."""
    rows = zip(tests["test_id"], tests["failure_mode"], tests["adj_ttc_s"], strict=True)
    return {test: f"{MODE_NAMES[mode]}, adj. TTC {value:.2f} s" for test, mode, value in rows}


def cards(
    found: FailureRegions, tests: Mapping[str, Sequence[str]], shown: Shown
) -> tuple[Card, ...]:
    """The cards of a scenario: its regions, then the failures in none. tests: those pictured, by card."""
    *regions, isolated = groups(found).items()
    return (
        *(
            _region(region, found, tests[name], shown)
            for region, (name, _) in zip(found.regions, regions, strict=True)
        ),
        *([_isolated(*isolated, tests[isolated[0]], shown)] if found.isolated else []),
    )


def _region(
    region: FailureRegion, found: FailureRegions, tests: Sequence[str], shown: Shown
) -> Card:
    why = region.why
    return Card(
        name=region.name,
        tag=region.status,
        text="" if why is None else why.sentence,
        rule=region.rule,
        members=len(region.members),
        facts=tuple(_facts(region, found)),
        pictures=tuple(_picture(test, shown) for test in tests),
        fewer=_fewer(len(tests), len(region.members)),
        bars=()
        if why is None
        else tuple(map(_bar, [*why.repairs, *([why.control] if why.control else [])])),
        replays=tuple(shown.films.get(region.name, ())),
        test=region.representatives[0].test_id,
    )


def _isolated(name: str, members: Sequence[str], tests: Sequence[str], shown: Shown) -> Card:
    return Card(
        name=name,
        tag="no region",
        text="Failures in no region. Some may lie inside the rule of a region whose failures have another cause.",
        rule="",
        members=len(members),
        facts=(("failures", str(len(members))),),
        pictures=tuple(_picture(test, shown) for test in tests),
        fewer=_fewer(len(tests), len(members)),
        bars=(),
        replays=(),
        test=(*tests, *members)[0],
    )


def _facts(region: FailureRegion, found: FailureRegions) -> list[tuple[str, str]]:
    held_back, unsolvable = region.held_back, set(region.members) & set(found.not_solvable)
    return [
        ("failures", str(len(region.members))),
        ("cause", CAUSES.get(region.cause, MIXED)),
        (
            "failures inside the rule",
            f"{region.failures_inside} / {region.support} = {share(region.precision)}",
        ),
        ("lift", f"{region.lift:.1f}"),
        (
            "held back",
            NONE
            if held_back.rate is None
            else f"{held_back.failures} / {held_back.tests} = {share(held_back.rate)}",
        ),
        ("covered by the rule", share(region.recall)),
        *_confirmation(region.confirmation),
        (
            "failure modes",
            ", ".join(f"{count} {MODE_NAMES[name]}" for name, count in region.modes if count),
        ),
        ("found by", ", ".join(f"{count} {name}" for name, count in region.strategies.items())),
        *([("not solvable with this camera", str(len(unsolvable)))] if unsolvable else []),
    ]


def _confirmation(found: Confirmation | None) -> list[tuple[str, str]]:
    """Fresh random tests and their failures inside the rule and just outside it."""
    if found is None:
        return [("fresh tests", NOT_EXECUTED)]
    return [
        ("fresh tests inside", fresh_counts(found.inside)),
        ("fresh tests just outside", fresh_counts(found.outside)),
        ("p, Fisher's exact test", f"{found.p_value:.2g}"),
    ]


def _bar(repair: Repair) -> Bar:
    errors = f"; errors: {repair.errors}" if repair.errors else ""
    rate = f" = {percent(repair.rate)}" if repair.rate else ""
    return Bar(
        repair.change,
        repair.repaired,
        max(1, repair.tests),
        f"{repair.repaired} / {repair.tests}{rate}{errors}",
    )


def _fewer(pictures: int, members: int) -> str:
    """Why a card has fewer pictures than usual; empty if it has all."""
    if pictures == min(PICTURES, members):
        return ""
    return (
        f"Frames were kept for {pictures} of its {members} failures."
        if pictures
        else "No frames of its failures were kept."
    )


def _picture(test: str, shown: Shown) -> Picture:
    """The frame, less sharp than it was kept, so that many fit on the page."""
    moment = shown.moments[test]
    scored = [
        (box, score, "reported" if score >= shown.reported_from else "unreported")
        for box, score in moment.detections[:BOXES]
    ]
    boxes = [
        Box(*box, kind=kind, label=_score(score)) for box, score, kind in reversed(scored)
    ]  # The best one on top.
    truth = [Box(*moment.truth, kind="truth")] if moment.truth else []
    words = f"{shown.ends[test]}. {_words(moment, shown.reported_from)}"
    return Picture(test, jpeg_uri(decode_jpeg(moment.image)), moment.size, (*truth, *boxes), words)


def _score(score: float) -> str:
    """Rounded down, so that no score below the threshold looks like it."""
    return f"{floor(100 * score + 1e-9) / 100:.2f}"


def _words(moment: Moment, reported_from: float) -> str:
    reported = sum(score >= reported_from for _, score in moment.detections)
    best = f", best score {_score(moment.detections[0][1])}" if moment.detections else ""
    return f"Pedestrian {'in sight' if moment.truth else 'hidden'}; reported detections: {reported}{best}."
