"""How far one sees in fog: the one mapping from the scenario variable to metres."""

from __future__ import annotations

FOG_FREE_RANGE_M, DENSE_FOG_RANGE_M = 1500.0, 40.0


def visual_range_m(fog: float) -> float:
    """Visual range in metres (meteorological optical range) at a fog of 0 to 100 %; each percent takes the same share away."""
    return float(FOG_FREE_RANGE_M * (DENSE_FOG_RANGE_M / FOG_FREE_RANGE_M) ** (fog / 100))
