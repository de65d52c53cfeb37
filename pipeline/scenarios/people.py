"""Populations of pedestrians: the body, clothes and gait of each person.

Source: thesis section 5.2, `Pedestrian Blueprint`. A population is made from its number alone: 37
women and 37 men, of whom the last four of each are children. Names are unique over all
populations. Population 1 is W 01 to W 37 and M 01 to M 37, population 2 is W 38 to W 74 and M 38 to
M 74, and so on.

Each person is drawn independently:

- Height: women 1.66 ± 0.06 m, men 1.79 ± 0.07 m, normal, within 1.5 to 1.98 m. The means are those
  of adults in Germany (Statistisches Bundesamt, Mikrozensus 2021). Children are uniform from 1.1 to
  1.4 m, about five to ten years old.
- Colours: a cloth, skin or hair colour of a list, lighter or darker by up to a quarter; skin by up
  to a tenth. Three of four pairs of trousers are dark or grey.
- Every fifth person wears a hat, three of ten carry a bag, one adult of eight holds an umbrella, a
  third of the women wear a skirt.
- Gait: stride 1 ± 0.06 of the average at the same height and speed, within 0.88 to 1.12; arm swing
  and stoop uniform.

Only the heights follow a source; clothes and gaits are chosen for variety.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from pipeline.core.words import Word

Colour = tuple[float, float, float]
Pattern = Literal["plain", "vest", "band"]
"""Patterns of the upper body: one colour, a chest in a second colour, or a belt in a second
colour."""

SEED = 20_231
OF_EACH_SEX, CHILDREN_OF_EACH_SEX = 37, 4
FIRST_RANDOM = 1000
"""The first number of the populations that random scenes draw; scenarios use smaller numbers."""
VARIABLE = "blueprint"
"""The scenario variable that names the person."""

POSE = "animation"
"""The scenario variable that names the pose."""
WORDS = (
    *(
        Word(pose, POSE, value=pose)
        for pose in ("walking", "texting", "crouching", "limping", "drunk")
    ),
    Word("stumbling", POSE, value="stumble"),
    Word("child", VARIABLE, "height_m", high=1.4),
    Word("adult", VARIABLE, "height_m", low=1.5),
    Word("under an umbrella", VARIABLE, "umbrella", low=1),
    Word("without an umbrella", VARIABLE, "umbrella", high=0),
    Word("with a hat", VARIABLE, "hat", low=1),
    Word("in a skirt", VARIABLE, "skirt", low=1),
    Word("with a bag", VARIABLE, "bag", low=1),
    Word("in a dark top", VARIABLE, "top_brightness", high=0.15),
    Word("in a bright top", VARIABLE, "top_brightness", low=0.5),
    Word("in dark trousers", VARIABLE, "trousers_brightness", high=0.15),
    Word("in bright trousers", VARIABLE, "trousers_brightness", low=0.5),
)
"""The words for people that rules of failure regions use, in the order in which they make a
phrase."""

# Cloth, linear RGB. Dark colours are common on purpose: people wear them, and they are hard to see
# at night.
CLOTH: tuple[Colour, ...] = (
    (0.05, 0.05, 0.06),
    (0.09, 0.1, 0.14),
    (0.12, 0.16, 0.3),
    (0.25, 0.26, 0.28),
    (0.45, 0.44, 0.42),
    (0.75, 0.74, 0.7),
    (0.9, 0.9, 0.88),
    (0.55, 0.1, 0.1),
    (0.8, 0.35, 0.1),
    (0.85, 0.72, 0.2),
    (0.2, 0.38, 0.2),
    (0.15, 0.35, 0.6),
    (0.45, 0.25, 0.5),
    (0.35, 0.24, 0.16),
)
SKIN: tuple[Colour, ...] = (
    (0.86, 0.68, 0.56),
    (0.78, 0.58, 0.44),
    (0.62, 0.43, 0.3),
    (0.42, 0.27, 0.18),
    (0.26, 0.17, 0.12),
)
HAIR: tuple[Colour, ...] = (
    (0.05, 0.04, 0.03),
    (0.18, 0.11, 0.06),
    (0.42, 0.28, 0.14),
    (0.7, 0.58, 0.36),
    (0.6, 0.6, 0.6),
)
PATTERNS: tuple[Pattern, ...] = ("plain", "plain", "vest", "band")


@dataclass(frozen=True)
class Blueprint:
    """A person. Colours are linear RGB.

    height: metres. child: drawn as a child. build: breadth relative to the average of that height.
    stride: its length relative to the average of that height and speed. arm_swing: relative to the
    average. stoop: radians that the upper body leans forward.
    """

    name: str
    child: bool
    height: float
    build: float
    stride: float
    arm_swing: float
    stoop: float
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


@lru_cache(maxsize=16)
def population(number: int) -> Mapping[str, Blueprint]:
    """The 74 people of a population by name, women first. number: 1 or more; ValueError below."""
    if number < 1:
        raise ValueError(f"the number of a population must be at least 1, got {number}")
    people = (_blueprint(number, index) for index in range(2 * OF_EACH_SEX))
    return MappingProxyType({person.name: person for person in people})


def person(name: str) -> Blueprint:
    """The person with this name, from any population.

    Raises:
        ValueError: nobody has this name.

    >>> person("W 01").child
    False
    """
    match = re.fullmatch(r"[WM] (\d{2,})", name)
    if match and int(match[1]):
        people = population((int(match[1]) - 1) // OF_EACH_SEX + 1)
        if name in people:
            return people[name]
    raise ValueError(f"expected a person such as 'W 01' or 'M 38', got '{name}'")


def fingerprint(number: int) -> str:
    """Identifies a population without revealing it: hexadecimal, from SHA-256."""
    return hashlib.sha256(f"people {number}".encode()).hexdigest()[:16]


def variable(number: int) -> dict[str, Any]:
    """The scenario variable `blueprint` of a population as plain data.

    Its attributes describe each person, so that strategies that learn from results expect similar
    people to fail alike.
    """
    people = population(number).values()
    attributes: dict[str, list[float]] = {"height_m": [person.height for person in people]}
    for name in ("umbrella", "bag", "hat", "skirt"):
        attributes[name] = [int(getattr(person, name)) for person in people]
    for name in ("top", "trousers"):
        attributes[f"{name}_brightness"] = [
            round(sum(getattr(person, name)) / 3, 3) for person in people
        ]
    return {
        "kind": "categorical",
        "values": [person.name for person in people],
        "attributes": attributes,
    }


def _blueprint(number: int, index: int) -> Blueprint:
    rng = np.random.default_rng([SEED, number, index])
    woman, place = index < OF_EACH_SEX, index % OF_EACH_SEX
    child = place >= OF_EACH_SEX - CHILDREN_OF_EACH_SEX
    mean, spread = (1.66, 0.06) if woman else (1.79, 0.07)
    height = rng.uniform(1.1, 1.4) if child else float(np.clip(rng.normal(mean, spread), 1.5, 1.98))
    return Blueprint(
        name=f"{'W' if woman else 'M'} {OF_EACH_SEX * (number - 1) + place + 1:02d}",
        child=child,
        height=round(height, 3),
        build=round(rng.uniform(0.9, 1.22), 3),
        stride=round(float(np.clip(rng.normal(1, 0.06), 0.88, 1.12)), 3),
        arm_swing=round(rng.uniform(0.5, 1.5), 3),
        stoop=round(rng.uniform(0, 0.12), 3),
        top=_colour(CLOTH, 0.25, rng),
        trousers=_colour(CLOTH[:6] if rng.random() < 0.75 else CLOTH, 0.25, rng),
        shoes=_colour(CLOTH[:5], 0.25, rng),
        skin=_colour(SKIN, 0.1, rng),
        hair=_colour(HAIR, 0.25, rng),
        accent=_colour(CLOTH[4:], 0.25, rng),
        pattern=PATTERNS[rng.integers(len(PATTERNS))],
        skirt=bool(woman and rng.random() < 0.35),
        long_hair=bool(woman and rng.random() < 0.6),
        hat=bool(rng.random() < 0.2),
        bag=bool(rng.random() < 0.3),
        umbrella=bool(not child and rng.random() < 0.12),
    )


def _colour(choices: tuple[Colour, ...], spread: float, rng: np.random.Generator) -> Colour:
    """One of the colours, lighter or darker by a factor of up to 1 ± spread."""
    red, green, blue = choices[rng.integers(len(choices))]
    factor = rng.uniform(1 - spread, 1 + spread)
    return (
        round(min(0.95, red * factor), 3),
        round(min(0.95, green * factor), 3),
        round(min(0.95, blue * factor), 3),
    )
