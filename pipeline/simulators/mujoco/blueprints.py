"""The 74 pedestrian blueprints: body and clothes of each pedestrian (thesis section 5.2, `Pedestrian Blueprint`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Colour = tuple[float, float, float]
Pattern = Literal["plain", "vest", "band"]
"""Patterns of the upper body: one colour, a chest in a second colour, or a belt in a second colour."""

WOMEN = tuple(f"W {i:02d}" for i in range(1, 38))
MEN = tuple(f"M {i:02d}" for i in range(1, 38))
NAMES = WOMEN + MEN
CHILDREN = WOMEN[-4:] + MEN[-4:]

# Cloth, linear RGB. Dark colours are common on purpose: people wear them, and they are hard to see at night.
CLOTH: tuple[Colour, ...] = (
    (0.05, 0.05, 0.06), (0.09, 0.1, 0.14), (0.12, 0.16, 0.3), (0.25, 0.26, 0.28), (0.45, 0.44, 0.42), (0.75, 0.74, 0.7), (0.9, 0.9, 0.88),
    (0.55, 0.1, 0.1), (0.8, 0.35, 0.1), (0.85, 0.72, 0.2), (0.2, 0.38, 0.2), (0.15, 0.35, 0.6), (0.45, 0.25, 0.5), (0.35, 0.24, 0.16),
)  # fmt: skip
SKIN: tuple[Colour, ...] = ((0.86, 0.68, 0.56), (0.78, 0.58, 0.44), (0.62, 0.43, 0.3), (0.42, 0.27, 0.18), (0.26, 0.17, 0.12))
HAIR: tuple[Colour, ...] = ((0.05, 0.04, 0.03), (0.18, 0.11, 0.06), (0.42, 0.28, 0.14), (0.7, 0.58, 0.36), (0.6, 0.6, 0.6))
PATTERNS: tuple[Pattern, ...] = ("plain", "plain", "vest", "band")


@dataclass(frozen=True)
class Blueprint:
    """One pedestrian's looks. height: metres; build: breadth relative to the average of that height; the others: linear RGB."""

    name: str
    height: float
    build: float
    top: Colour
    trousers: Colour
    shoes: Colour
    skin: Colour
    hair: Colour
    accent: Colour
    pattern: Pattern
    skirt: bool
    long_hair: bool
    hat: bool
    bag: bool
    umbrella: bool

    @property
    def chest(self) -> Colour:
        return self.accent if self.pattern == "vest" else self.top

    @property
    def abdomen(self) -> Colour:
        return self.accent if self.pattern == "band" else self.top


def _blueprint(index: int) -> Blueprint:
    """Blueprint `index` of `NAMES`; children measure 1.1 to 1.4 m."""
    rng, name = np.random.default_rng([20_231, index]), NAMES[index]
    woman = index < len(WOMEN)
    child = name in CHILDREN
    mean, spread = (1.66, 0.06) if woman else (1.79, 0.07)
    height = rng.uniform(1.1, 1.4) if child else float(np.clip(rng.normal(mean, spread), 1.5, 1.98))
    return Blueprint(
        name=name,
        height=round(height, 3),
        build=round(rng.uniform(0.9, 1.22), 3),
        top=CLOTH[rng.integers(len(CLOTH))],
        trousers=CLOTH[rng.integers(6)] if rng.random() < 0.75 else CLOTH[rng.integers(len(CLOTH))],
        shoes=CLOTH[rng.integers(5)],
        skin=SKIN[rng.integers(len(SKIN))],
        hair=HAIR[rng.integers(len(HAIR))],
        long_hair=bool(woman and rng.random() < 0.6),
        hat=bool(rng.random() < 0.2),
        bag=bool(rng.random() < 0.3),
        accent=CLOTH[rng.integers(4, len(CLOTH))],
        pattern=PATTERNS[rng.integers(len(PATTERNS))],
        skirt=bool(woman and rng.random() < 0.35),
        umbrella=bool(not child and rng.random() < 0.12),
    )


BLUEPRINTS = {name: _blueprint(index) for index, name in enumerate(NAMES)}
