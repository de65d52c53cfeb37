"""A card for each failure region: sentence, rule, numbers, pictures, repairs and films."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import floor

import pandas as pd

from pipeline.artefacts.dataset import decode_jpeg
from pipeline.artefacts.region_results import FailureRegion, FailureRegions, Why
from pipeline.report.explorer import groups
from pipeline.report.failure_tables import CAUSES, MIXED, NONE
from pipeline.report.formats import fresh_counts, percent, share
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
    """What cards show besides the failure regions.

    Attributes:
        moments: Test -> its decisive moment.
        ends: Test -> how it ended, in words.
        films: Region -> films of its failures.
        reported_from: Lowest score that the detector reports, in [0, 1].
    """

    moments: Mapping[str, Moment]
    ends: Mapping[str, str]
    films: Mapping[str, Sequence[Film]]
    reported_from: float

    def picture(self, test: str) -> Picture:
        """The decisive frame, compressed more strongly than the campaign kept it."""
        moment = self.moments[test]
        boxes = [Box(*moment.truth, kind="truth")] if moment.truth else []
        for box, score in reversed(moment.detections[:BOXES]):  # The best one on top.
            kind = "reported" if score >= self.reported_from else "unreported"
            boxes.append(Box(*box, kind=kind, label=_score(score)))
        reported = sum(score >= self.reported_from for _, score in moment.detections)
        sight = "in sight" if moment.truth else "hidden"
        best = f", best score {_score(moment.detections[0][1])}" if moment.detections else ""
        words = f"Pedestrian {sight}; reported detections: {reported}{best}."
        image = jpeg_uri(decode_jpeg(moment.image))
        return Picture(test, image, moment.size, tuple(boxes), f"{self.ends[test]}. {words}")


def pictured(regions: FailureRegions, frames: KeptFrames) -> dict[str, tuple[str, ...]]:
    """The tests on each card of a scenario: at most `PICTURES` with kept frames.

    A region's representatives come before its other failures.
    """
    representatives: dict[str, list[str]] = {}
    for region in regions.regions:
        representatives[region.name] = [test.test_id for test in region.representatives]
    with_frames, chosen = frames.tests, {}
    for name, members in groups(regions).items():
        ordered = dict.fromkeys([*representatives.get(name, []), *members])
        chosen[name] = tuple([test for test in ordered if test in with_frames][:PICTURES])
    return chosen


def ends(tests: pd.DataFrame) -> dict[str, str]:
    """How each test ended: `contact, adj. TTC 0.02 s`. tests: rows of tests.parquet, no errors."""
    rows = zip(tests["test_id"], tests["failure_mode"], tests["adj_ttc_s"], strict=True)
    return {test: f"{MODE_NAMES[mode]}, adj. TTC {value:.2f} s" for test, mode, value in rows}


def cards(
    regions: FailureRegions, tests: Mapping[str, Sequence[str]], shown: Shown
) -> tuple[Card, ...]:
    """The cards of a scenario: its regions, then the failures in no region.

    Args:
        regions: The failure regions of the scenario.
        tests: Card -> the tests with a picture on it, from `pictured`.
        shown: Pictures, words and films of the tests.
    """
    result = [_card(region, regions, tests[region.name], shown) for region in regions.regions]
    if regions.isolated:
        name, members = list(groups(regions).items())[-1]
        text = (
            "Failures in no region. Some may lie inside the rule of a region whose failures "
            "have another cause."
        )
        isolated = Card(
            name=name,
            tag="no region",
            text=text,
            rule="",
            members=len(members),
            facts=(("failures", str(len(members))),),
            pictures=tuple(map(shown.picture, tests[name])),
            fewer=_fewer(len(tests[name]), len(members)),
            bars=(),
            replays=(),
            test=(*tests[name], *members)[0],
        )
        result.append(isolated)
    return tuple(result)


def _card(
    region: FailureRegion, regions: FailureRegions, tests: Sequence[str], shown: Shown
) -> Card:
    unsolvable = set(region.members) & set(regions.not_solvable)
    return Card(
        name=region.name,
        tag=region.status,
        text=region.why.sentence if region.why else "",
        rule=region.rule,
        members=len(region.members),
        facts=tuple(_facts(region, len(unsolvable))),
        pictures=tuple(map(shown.picture, tests)),
        fewer=_fewer(len(tests), len(region.members)),
        bars=_bars(region.why) if region.why else (),
        replays=tuple(shown.films.get(region.name, ())),
        test=region.representatives[0].test_id,
    )


def _facts(region: FailureRegion, unsolvable: int) -> list[tuple[str, str]]:
    """Names and values. unsolvable: number of failures that no detector could avoid."""
    inside = f"{region.failures_inside} / {region.support} = {share(region.precision)}"
    held_back, rate = region.held_back, region.held_back.rate
    facts = [
        ("failures", str(len(region.members))),
        ("cause", CAUSES.get(region.cause, MIXED)),
        ("failures inside the rule", inside),
        ("lift", f"{region.lift:.1f}"),
        (
            "held back",
            NONE if rate is None else f"{held_back.failures} / {held_back.tests} = {share(rate)}",
        ),
        ("covered by the rule", share(region.recall)),
    ]
    if (fresh := region.confirmation) is None:
        facts.append(("fresh tests", NOT_EXECUTED))
    else:
        facts += [
            ("fresh tests inside", fresh_counts(fresh.inside)),
            ("fresh tests just outside", fresh_counts(fresh.outside)),
            ("p, Fisher's exact test", f"{fresh.p_value:.2g}"),
        ]
    modes = (f"{count} {MODE_NAMES[name]}" for name, count in region.modes if count)
    strategies = (f"{count} {name}" for name, count in region.strategies.items())
    facts += [("failure modes", ", ".join(modes)), ("found by", ", ".join(strategies))]
    if unsolvable:
        facts.append(("not solvable with this camera", str(unsolvable)))
    return facts


def _bars(why: Why) -> tuple[Bar, ...]:
    """A bar for each repair, then for the control."""
    bars = []
    for repair in [*why.repairs, *([why.control] if why.control else [])]:
        text = f"{repair.repaired} / {repair.tests}"
        if repair.rate:
            text += f" = {percent(repair.rate)}"
        if repair.errors:
            text += f"; errors: {repair.errors}"
        bars.append(Bar(repair.change, repair.repaired, max(1, repair.tests), text))
    return tuple(bars)


def _fewer(pictures: int, members: int) -> str:
    """Why a card has fewer pictures than usual; empty if it has all."""
    if pictures == min(PICTURES, members):
        return ""
    if not pictures:
        return "No frames of its failures were kept."
    return f"Frames were kept for {pictures} of its {members} failures."


def _score(score: float) -> str:
    """Rounded down: a score below the threshold must not look like it."""
    return f"{floor(100 * score + 1e-9) / 100:.2f}"
