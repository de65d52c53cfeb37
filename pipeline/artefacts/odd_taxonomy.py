"""The concepts of an OpenODD taxonomy (ASAM OpenODD 1.0, section 10.2).

They are numbers, truth values and literals in nested records.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from pipeline.artefacts.odd_numbers import Bounds, bounds, in_unit, is_bounds
from pipeline.core.names import nearest
from pipeline.errors import shown

NUMBERS = ("integer", "long", "float", "double")
TRUTH = ("true", "false")
SHAPEFILE = "shapefile"


@dataclass(frozen=True)
class Concept:
    """A leaf of the taxonomy.

    Attributes:
        path: from the top record.
        literals: of a categorical or boolean concept.
        unit_type: of a number.
        ranges: what each literal means for the number `base`, if ranges define the literals; these
            are then in the order of the ranges.
    """

    path: tuple[str, ...]
    literals: tuple[str, ...] = ()
    unit_type: str = ""
    whole: bool = False
    base: str = ""
    ranges: tuple[Bounds, ...] = ()

    @property
    def where(self) -> str:
        return ".".join(("TAXONOMY", *self.path))

    @property
    def ends(self) -> list[tuple[str, ...]]:
        """The ends of its path, the shortest first."""
        return [self.path[start:] for start in reversed(range(len(self.path)))]

    @property
    def is_number(self) -> bool:
        return not self.literals and self.unit_type != SHAPEFILE


class Taxonomy:
    """Concepts by their names: the shortest end of the path that only one concept has."""

    def __init__(self, plain: Mapping[str, Any]) -> None:
        """Read the concepts.

        Raises:
            ValueError: naming the place of a wrong leaf, or a concept with the name of another.
        """
        self.concepts: dict[str, Concept] = {}
        concepts = list(_concepts((), plain))
        ends = Counter(end for concept in concepts for end in concept.ends)
        for concept in concepts:
            unique = [end for end in concept.ends if ends[end] == 1]
            if not unique:
                raise ValueError(f"{concept.where}: this concept is declared twice")
            self.concepts[".".join(unique[0])] = concept

    def find(self, where: str, name: str) -> str:
        """The name of the concept that the end of a path means.

        Raises:
            ValueError: for none and for several.
        """
        if name in self.concepts:
            return name
        end = tuple(name.split("."))
        matches = [key for key, concept in self.concepts.items() if end in concept.ends]
        if len(matches) > 1:
            raise ValueError(f"{where}: {name} is one of {', '.join(matches)}; name one of them")
        if not matches:
            raise ValueError(f"{where}: there is no concept {name}{nearest(name, self.concepts)}")
        return matches[0]

    def below(self, where: str, name: str) -> list[str]:
        """The concepts inside a record, or the concept of this name itself."""
        inside = [
            key
            for key, concept in self.concepts.items()
            if f".{name}." in f".{'.'.join(concept.path)}."
        ]
        if not inside:
            names = set(self.concepts)
            for concept in self.concepts.values():
                names.update(concept.path[:-1])
            hint = nearest(name, names)
            raise ValueError(f"{where}: there is no record or concept {name}{hint}")
        return inside


def _concepts(path: tuple[str, ...], plain: Any) -> Iterator[Concept]:
    where = ".".join(("TAXONOMY", *path))
    match plain:
        case dict() if path and (ranges := _ranges(where, plain)):
            yield _ordered(where, path, ranges)
        case dict():
            for name, inner in plain.items():
                yield from _concepts((*path, str(name)), inner)
        case list():
            texts = all(isinstance(literal, str) for literal in plain)
            if not plain or not texts or len(set(plain)) < len(plain):
                raise ValueError(
                    f"{where}: expected a list of distinct literals, got {shown(plain)}"
                )
            yield Concept(path, tuple(plain))
        case "boolean":
            yield Concept(path, TRUTH)
        case "shapefile":
            yield Concept(path, unit_type=SHAPEFILE)
        case str() if (words := plain.split()) and words[0] in NUMBERS and len(words) == 2:
            yield Concept(path, unit_type=words[1], whole=words[0] in NUMBERS[:2])
        case _:
            raise ValueError(
                f"{where}: expected a record, a list of literals, boolean, shapefile or a number "
                f"such as 'float length', got {shown(plain)}"
            )


def _ranges(where: str, plain: Mapping[Any, Any]) -> dict[str, tuple[str, Bounds]]:
    """Literal -> number and bounds, if bounds of one number define the literals; else nothing."""
    if not all(isinstance(literal, dict) for literal in plain.values()):
        return {}
    inner = [item for literal in plain.values() for item in literal.items()]
    if not inner or not all(isinstance(text, str) and is_bounds(text) for _, text in inner):
        return {}
    if len({name for name, _ in inner}) > 1 or len(inner) != len(plain):
        raise ValueError(
            f"{where}: expected literals that the bounds of one number define, got "
            f"{', '.join(str(name) for name, _ in inner)}"
        )
    return {
        str(literal): (str(name), bounds(text))
        for literal, (name, text) in zip(plain, inner, strict=True)
    }


def _ordered(
    where: str, path: tuple[str, ...], ranges: Mapping[str, tuple[str, Bounds]]
) -> Concept:
    unit = next(iter(ranges.values()))[1].unit
    if any(limits.unit != unit for _, limits in ranges.values()):
        raise ValueError(
            f"{where}: expected one unit for all literals, got "
            f"{', '.join(limits.unit for _, limits in ranges.values())}"
        )
    order = sorted(ranges, key=lambda literal: (ranges[literal][1].low, ranges[literal][1].high))
    for first, second in pairwise(order):
        if ranges[first][1].high > ranges[second][1].low:
            raise ValueError(f"{where}: the ranges of {first} and {second} overlap")
    return Concept(
        path,
        tuple(order),
        base=ranges[order[0]][0],
        ranges=tuple(ranges[literal][1] for literal in order),
    )


def literals_within(concept: Concept, bounds: Bounds, unit_type: str) -> frozenset[int]:
    """Indices of the literals whose ranges are inside bounds of their number.

    Raises:
        ValueError: if the bounds cut through one.
    """
    inside = set()
    for index, part in enumerate(concept.ranges):
        limits = in_unit(bounds, part.unit, unit_type)
        if limits.holds_all(part):
            inside.add(index)
        elif not limits.holds_none(part):
            raise ValueError(
                f"this cuts through the literal {concept.literals[index]} of {concept.path[-1]}; "
                "end a literal there"
            )
    return frozenset(inside)
