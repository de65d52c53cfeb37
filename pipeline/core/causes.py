"""Why a test failed: what the detector reported while braking would still have helped."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.matching import TOUCH_IOU
from pipeline.core.signals import Signals
from pipeline.core.visibility import visible

Cause = Literal[
    "none",
    "not_solvable",
    "never_seen",
    "lost_after_detection",
    "too_late",
    "box",
    "confidence",
    "false_positives",
    "false_activation",
]
"""none: no failure. not_solvable: no frame in which a person could see the pedestrian came in time,
see `solvable`. false_positives, false_activation: as the failure mode. Otherwise:

- never_seen: in no frame does a reported detection touch the pedestrian, or one with a lower score
  fit it.
- lost_after_detection: the brake acted, was released because the pedestrian was lost, and the ego
  accelerated (thesis Fig. 7.6c).

The others judge the frames that came in time, in which a person could see the pedestrian and no
reported detection matched. The most frequent one counts, in equal numbers the first:

- too_late: there is nothing; or every frame had a match, and the brake followed too late or too
  weakly;
- box: a reported detection touches the pedestrian, but its box does not fit;
- confidence: a detection fits, but its score is too low to be reported.
"""


def solvable(signals: Signals) -> bool:
    """Whether full braking would have helped in a frame in which a person could see the pedestrian.

    A person sees what is `visible`. If the answer is no, no detector that judges single images as
    well as a person could pass the test with this camera: sensor and sight line are the limit. The
    pedestrian's own motion out of the way does not count.

    Args:
        signals: of the test.
    """
    return bool(_in_time(signals).any())


def cause(signals: Signals, failure_mode: str) -> Cause:
    """The cause of a failure.

    Args:
        signals: of the test.
        failure_mode: as in tests.parquet.
    """
    if failure_mode == "none":
        return "none"
    if failure_mode == "false_activation":
        return "false_activation"
    if failure_mode == "false_positives":
        return "false_positives"
    if not solvable(signals):
        return "not_solvable"
    overlap, weak = np.asarray(signals["overlap"]), np.asarray(signals["any_confidence"])
    if not ((overlap > TOUCH_IOU) | (weak > 0)).any():
        return "never_seen"
    faster = np.diff(np.asarray(signals["ego_speed_mps"]), append=-np.inf) > 0
    if (np.asarray(signals["lost"], dtype=bool) & faster).any():
        return "lost_after_detection"
    unmatched = _in_time(signals) & (np.asarray(signals["confidence"]) == 0)
    low, badly = unmatched & (weak > 0), unmatched & (weak == 0) & (overlap > TOUCH_IOU)
    counts: dict[Cause, int] = {
        "too_late": int((unmatched & ~low & ~badly).sum()),
        "box": int(badly.sum()),
        "confidence": int(low.sum()),
    }
    return max(counts, key=lambda name: counts[name])


def _in_time(signals: Signals) -> NDArray[np.bool_]:
    """The frames in which a person could see the pedestrian and braking would have helped, (t,)."""
    seen = visible(signals["visible_pixels"], signals["contrast"])
    left_m, needed_m = (
        np.asarray(signals[f"{kind}_distance_m"]) for kind in ("conflict", "stopping")
    )
    return np.asarray(seen & (left_m > needed_m))
