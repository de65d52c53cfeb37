"""The look of a town: urban for search and training, suburban for held-out scenarios."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.simulators.mujoco import textures


@dataclass(frozen=True)
class Style:
    """The look of a town."""

    walls: tuple[textures.Colour, ...]
    brick: tuple[bool, ...]
    roofs: tuple[textures.Colour, ...]
    asphalt: int
    paving: textures.Colour
    leaves: textures.Colour
    conical: bool
    storeys: tuple[int, int]
    widths: tuple[float, float]
    gap: float
    setback: float
    shops: bool
    lamp_reach: float
    lamp_height: float


STYLES = {
    "urban": Style(
        walls=((178, 112, 88), (204, 190, 162), (150, 150, 154), (214, 200, 160), (132, 88, 72)),
        brick=(True, False, False, False, True),
        roofs=((96, 58, 48), (74, 74, 80)),
        asphalt=74,
        paving=(150, 147, 140),
        leaves=(62, 92, 44),
        conical=False,
        storeys=(2, 5),
        widths=(11.0, 18.0),
        gap=0.25,
        setback=1.6,
        shops=True,
        lamp_reach=1.5,
        lamp_height=6.2,
    ),
    "suburban": Style(
        walls=((226, 218, 200), (196, 150, 120), (170, 182, 186), (232, 226, 214)),
        brick=(False, True, False, False),
        roofs=((126, 70, 54), (88, 72, 64)),
        asphalt=92,
        paving=(128, 122, 118),
        leaves=(84, 106, 46),
        conical=True,
        storeys=(1, 2),
        widths=(9.0, 13.0),
        gap=5.0,
        setback=6.0,
        shops=False,
        lamp_reach=0.6,
        lamp_height=5.2,
    ),
}
