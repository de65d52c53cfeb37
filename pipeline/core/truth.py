"""Ground truth of one camera frame."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.core.boxes import Box
from pipeline.core.visibility import visible


@dataclass(frozen=True)
class Truth:
    """Ground truth of the one pedestrian of a frame.

    Attributes:
        visible_box: left, top, right, bottom of the visible part in pixels; None without one.
        whole_box: of the part that would be visible without occluders.
        visible_pixels: number of visible pixels.
        whole_pixels: number of pixels without occluders.
        contrast: mean absolute grey-level difference between the visible pixels and the ring around
            their box.
    """

    visible_box: Box | None = None
    whole_box: Box | None = None
    visible_pixels: int = 0
    whole_pixels: int = 0
    contrast: float = 0.0

    @property
    def barely_visible(self) -> bool:
        """Whether a person could hardly see the pedestrian, see `pipeline.core.visibility`."""
        return not visible(self.visible_pixels, self.contrast)
