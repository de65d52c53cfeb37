"""Stills of one test before and after retraining: what two versions report in the same camera image."""

from __future__ import annotations

import numpy as np

from pipeline.core.episode import Episode, KeptFrame
from pipeline.core.kpi import evaluate
from pipeline.report.page import BeforeAfter, Still
from pipeline.report.replays import draw_view, jpeg_uri, outcome_text


def before_after(
    title: str, versions: tuple[str, str], episodes: tuple[Episode, Episode], threshold_s: float
) -> BeforeAfter:
    """The moment in which the later version's confidence is furthest above the earlier one's, with how both tests end.

    versions: the earlier one, the later one. episodes: of the same test, all frames kept. threshold_s: the adj. TTC of a failure.
    """
    stills = [
        Still(
            f"{version}: {outcome_text(evaluate(episode.signals, threshold_s))}",
            jpeg_uri(draw_view(kept)),
        )
        for version, episode, kept in zip(versions, episodes, moment(*episodes), strict=True)
    ]
    return BeforeAfter(title, *stills)


def moment(before: Episode, after: Episode) -> tuple[KeptFrame, KeptFrame]:
    """Among the frames that are the same image in both episodes, those with the largest gain in the confidence of a match; the last of
    several. The cars drive apart as soon as one of them brakes; the first frame is always the same."""
    same = [
        pair
        for pair in zip(before.frames, after.frames, strict=False)
        if np.array_equal(pair[0].frame.image, pair[1].frame.image)
    ]
    return max(
        reversed(same), key=lambda pair: pair[1].matching.confidence - pair[0].matching.confidence
    )
