"""Where the sun stands over a year at a latitude."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.core.variable import Floats

DAYS, STEPS = 365, 12
"""Days of the year and moments of an hour at which the sun is looked up."""
AXIAL_TILT_DEG = 23.44
SOLSTICE = -10
"""Day of the year of the winter solstice, from 1 January."""


def altitudes(latitude_deg: float, hours: Sequence[float]) -> tuple[Floats, Floats]:
    """Altitudes of the sun over a year.

    Declination by Cooper's cosine, sin(altitude) = sin φ sin δ + cos φ cos δ cos H (Duffie &
    Beckman, Solar Engineering of Thermal Processes, section 1.6). The error of half a degree is far
    below the step of a scenario's altitude.

    Args:
        latitude_deg: -90 to 90, north positive.
        hours: weight of each hour of the day, 24 numbers from 0, in solar time, so 12 is noon.

    Returns:
        Altitudes in degrees and their shares, (n,) and (n,).

    Raises:
        ValueError: an argument out of range.
    """
    weights = np.asarray(hours, float)
    if weights.shape != (24,) or not (weights >= 0).all() or not weights.sum() > 0:
        raise ValueError(f"hours must be 24 numbers from 0, not all 0, got {list(hours)}")
    if not -90 <= latitude_deg <= 90:
        raise ValueError(f"latitude_deg must be in [-90, 90], got {latitude_deg}")
    day = np.arange(DAYS)[:, None]
    clock = (np.arange(24 * STEPS) + 0.5)[None] / STEPS
    declination = np.radians(-AXIAL_TILT_DEG * np.cos(2 * np.pi * (day - SOLSTICE) / DAYS))
    turned, latitude = np.radians(15 * (clock - 12)), np.radians(latitude_deg)
    sine = np.sin(latitude) * np.sin(declination)
    sine = sine + np.cos(latitude) * np.cos(declination) * np.cos(turned)
    shares = np.broadcast_to(weights[clock.astype(int)], sine.shape)
    return np.degrees(np.arcsin(np.clip(sine, -1, 1))).ravel(), (shares / shares.sum()).ravel()
