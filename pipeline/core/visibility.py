"""What a person can see: the visual range in fog, and whether a pedestrian can be made out."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FOG_FREE_RANGE_M, DENSE_FOG_RANGE_M = 1500.0, 40.0
MIN_VISIBLE_PIXELS = 30
MIN_CONTRAST = 8.0
"""Grey levels."""


def visual_range_m(fog: float) -> float:
    """Visual range in metres (meteorological optical range) at a fog of 0 to 100 %; each percent reduces it by the same share."""
    return float(FOG_FREE_RANGE_M * (DENSE_FOG_RANGE_M / FOG_FREE_RANGE_M) ** (fog / 100))


def detectability(pixels: ArrayLike, contrast: ArrayLike) -> NDArray[np.float64]:
    """Contrast in grey levels times the square root of the visible pixels: the eye detects a fainter object if it is larger (Rose, The
    sensitivity performance of the human eye, 1948).

    pixels, contrast: arrays of one shape, or numbers.
    """
    return np.asarray(np.asarray(contrast) * np.sqrt(np.asarray(pixels)))


def visible(pixels: ArrayLike, contrast: ArrayLike) -> NDArray[np.bool_]:
    """Whether a person can make out a pedestrian with this many visible pixels (at least 30) and this contrast (at least 8 grey levels).

    pixels, contrast: arrays of one shape, or numbers.
    """
    return np.asarray(
        (np.asarray(pixels) >= MIN_VISIBLE_PIXELS) & (np.asarray(contrast) >= MIN_CONTRAST)
    )
