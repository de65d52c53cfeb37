"""What a person can see: the visual range in fog, and whether a pedestrian can be made out."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FOG_FREE_RANGE_M, DENSE_FOG_RANGE_M = 1500.0, 40.0
MIN_VISIBLE_PIXELS = 30
MIN_CONTRAST = 8.0
"""Grey levels."""


def visual_range_m(fog: float) -> float:
    """Visual range in metres (meteorological optical range) at a fog of 0 to 100 %.

    Each percent reduces it by the same share.

    >>> round(visual_range_m(0)), round(visual_range_m(100))
    (1500, 40)
    """
    return float(FOG_FREE_RANGE_M * (DENSE_FOG_RANGE_M / FOG_FREE_RANGE_M) ** (fog / 100))


def detectability(pixels: ArrayLike, contrast: ArrayLike) -> NDArray[np.float64]:
    """Contrast in grey levels times the square root of the visible pixels.

    The eye detects a fainter object if it is larger (Rose, The sensitivity performance of the human
    eye, 1948).

    Args:
        pixels: number of visible pixels.
        contrast: grey levels, of the same shape.
    """
    return np.asarray(np.asarray(contrast) * np.sqrt(np.asarray(pixels)))


def visible(pixels: ArrayLike, contrast: ArrayLike) -> NDArray[np.bool_]:
    """Whether a person can make out a pedestrian: 30 visible pixels and 8 grey levels suffice.

    Args:
        pixels: number of visible pixels.
        contrast: grey levels, of the same shape.

    >>> visible([29, 30, 30], [50.0, 7.9, 8.0]).tolist()
    [False, False, True]
    """
    large = np.asarray(pixels) >= MIN_VISIBLE_PIXELS
    return np.asarray(large & (np.asarray(contrast) >= MIN_CONTRAST))
