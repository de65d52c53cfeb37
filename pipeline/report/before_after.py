"""Stills of one test before and after retraining: two versions on the same camera image."""

from __future__ import annotations

import numpy as np

from pipeline.core.episode import Episode, KeptFrame
from pipeline.core.kpi import evaluate
from pipeline.report.page import BeforeAfter, Still
from pipeline.report.replays import draw_view, jpeg_uri, outcome_text


def before_after(
    title: str, versions: tuple[str, str], episodes: tuple[Episode, Episode], threshold_s: float
) -> BeforeAfter:
    """The moment of the largest gain in confidence, and how both tests end.

    Args:
        title: Title of the pair.
        versions: The earlier and the later version.
        episodes: The same test with each version, all frames kept.
        threshold_s: Adj. TTC at or below which a test fails.
    """
    stills = []
    for version, episode, kept in zip(versions, episodes, moment(*episodes), strict=True):
        outcome = outcome_text(evaluate(episode.signals, threshold_s))
        stills.append(Still(f"{version}: {outcome}", jpeg_uri(draw_view(kept))))
    return BeforeAfter(title, *stills)


def moment(before: Episode, after: Episode) -> tuple[KeptFrame, KeptFrame]:
    """The frames with the largest gain in the confidence of a match; the last of several.

    Only frames with the same image count. The images differ as soon as one of the cars brakes; the
    first one is always the same.
    """
    pairs = zip(before.frames, after.frames, strict=False)
    same = [pair for pair in pairs if np.array_equal(pair[0].frame.image, pair[1].frame.image)]
    return max(
        reversed(same), key=lambda pair: pair[1].matching.confidence - pair[0].matching.confidence
    )
