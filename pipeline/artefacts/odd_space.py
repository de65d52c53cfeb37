"""The space of an OpenODD taxonomy.

Its concepts become variables; its modules and what may be absent become constraints.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import inf
from typing import Any

from pipeline.artefacts.data_set import NOT_APPLICABLE
from pipeline.artefacts.odd_conditions import categories_meant, ends_of
from pipeline.artefacts.odd_modules import Meaning, Modules
from pipeline.artefacts.odd_numbers import SIGNED, Bounds, bounds, in_unit
from pipeline.artefacts.odd_taxonomy import Concept, Taxonomy
from pipeline.artefacts.statements import Statement, space_with
from pipeline.core.expressions import Every, Expression, Not, OneOf, Some
from pipeline.core.names import nearest
from pipeline.core.space import Space, Variable
from pipeline.errors import shown

COVERAGE = ("CONCEPTS", "CUTS", "OPTIONAL", "APPLIES_IF")
UNKNOWN = ("unknown", "none", "null", "undefined")
"""What stands for a missing value."""


def odd_space(parts: Mapping[str, Mapping[str, Any]]) -> Space:
    """The space of the sections TAXONOMY, MODULES, ODD and COVERAGE.

    Raises:
        ValueError: naming the place of what is wrong.
    """
    return _Odd(parts).space()


class _Odd:
    def __init__(self, parts: Mapping[str, Mapping[str, Any]]) -> None:
        self._taxonomy = Taxonomy(parts["TAXONOMY"])
        self._modules = Modules(parts["ODD"], parts["MODULES"])
        self._coverage = parts["COVERAGE"]
        for key in self._coverage:
            if key not in COVERAGE:
                raise ValueError(f"COVERAGE: unknown key '{key}'{nearest(str(key), COVERAGE)}")
        self._cuts: dict[str, dict[float, None]] = {}
        self._units: dict[str, str] = {}
        self._variables: list[Variable] = []
        self._index: dict[str, int] = {}

    def space(self) -> Space:
        """The space of the chosen concepts in which the ODD holds."""
        kept = self._kept()
        self._collect_cuts()
        optional = set()
        for name in (*self._list("OPTIONAL"), *self._mapping("APPLIES_IF")):
            optional |= set(self._taxonomy.below("COVERAGE", name))
        self._variables = [
            self._variable(name, self._taxonomy.concepts[name], name in optional) for name in kept
        ]
        if not self._variables:
            raise ValueError("TAXONOMY: expected concepts, got none")
        self._index = {name: index for index, name in enumerate(kept)}
        return space_with(
            self._variables, [*self._parents(), *self._modules.statements(self._meaning)]
        )

    def _list(self, key: str) -> list[str]:
        names = self._coverage.get(key) or []
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError(f"COVERAGE.{key}: expected a list of names, got {shown(names)}")
        return names

    def _mapping(self, key: str) -> dict[str, Any]:
        section = self._coverage.get(key) or {}
        if not isinstance(section, dict):
            raise ValueError(f"COVERAGE.{key}: expected a mapping, got {shown(section)}")
        return section

    def _kept(self) -> list[str]:
        """The concepts that are variables.

        These are the chosen ones, or all except numbers whose ranges define literals.
        """
        concepts = self._taxonomy.concepts
        bases = {self._base(name) for name, concept in concepts.items() if concept.base}
        chosen = self._list("CONCEPTS")
        if not chosen:
            return [name for name in concepts if name not in bases]
        kept = set()
        for part in chosen:
            for name in self._taxonomy.below("COVERAGE.CONCEPTS", part):
                kept.add((self._ordered(name) or name) if name in bases else name)
        return [name for name in concepts if name in kept]

    def _base(self, name: str) -> str:
        """The number that defines the literals of a concept: the one declared nearest to it."""
        concept = self._taxonomy.concepts[name]
        for depth in reversed(range(len(concept.path))):
            path = (*concept.path[:depth], concept.base)
            for number, candidate in self._taxonomy.concepts.items():
                if candidate.path == path and candidate.is_number:
                    return number
        return self._taxonomy.find(concept.where, concept.base)

    def _ordered(self, number: str) -> str | None:
        """The concept whose literals are ranges of a number; None if there is none."""
        ordered = [
            name
            for name, concept in self._taxonomy.concepts.items()
            if concept.base and self._base(name) == number
        ]
        if len(ordered) > 1:
            raise ValueError(
                f"{self._taxonomy.concepts[number].where}: expected literals of one concept, got "
                f"{' and '.join(ordered)}"
            )
        return ordered[0] if ordered else None

    def _collect_cuts(self) -> None:
        """The ends of all bounds that statements set, and the cuts that are asked for."""
        for name, cuts in self._mapping("CUTS").items():
            where = f"COVERAGE.CUTS.{name}"
            if not isinstance(cuts, list) or not all(isinstance(cut, str) for cut in cuts):
                raise ValueError(
                    f"{where}: expected a list such as [30 km/h, 60 km/h], got {shown(cuts)}"
                )
            for cut in cuts:
                with _at(where):
                    limits = bounds(cut)
                self._cut(where, self._number(where, name), Bounds(limits.low, inf, limits.unit))
        self._modules.statements(self._cutting)
        for child, condition in self._mapping("APPLIES_IF").items():
            self._applies(child, condition, self._cutting)

    def _number(self, where: str, name: str) -> str:
        number = self._taxonomy.find(where, name)
        if not self._taxonomy.concepts[number].is_number:
            raise ValueError(
                f"{where}: expected a number, got {number} with "
                f"{', '.join(self._taxonomy.concepts[number].literals)}"
            )
        return number

    def _cutting(self, where: str, key: str, plain: Any, grows: bool) -> Expression:
        name = self._taxonomy.find(where, key)
        concept = self._taxonomy.concepts[name]
        for text in plain if isinstance(plain, list) else [plain]:
            if (
                concept.is_number
                and isinstance(text, str)
                and text not in UNKNOWN
                and self._ordered(name) is None
            ):
                with _at(where):
                    limits = bounds(text)
                self._cut(where, name, limits)
        return Every(())

    def _cut(self, where: str, name: str, limits: Bounds) -> None:
        concept = self._taxonomy.concepts[name]
        unit = self._units.setdefault(name, limits.unit)
        with _at(where):
            limits = in_unit(limits, unit, concept.unit_type)
        cuts = self._cuts.setdefault(name, {})
        for end in ends_of(concept, limits):
            cuts[end] = None

    def _variable(self, name: str, concept: Concept, optional: bool) -> Variable:
        if concept.literals:
            absent = (NOT_APPLICABLE,) if optional else ()
            return Variable(name, "categorical", values=(*concept.literals, *absent))
        why = ""
        if not concept.is_number:
            why = "a shape file has no categories"
        elif not self._cuts.get(name):
            why = "no statement compares this number; give it COVERAGE.CUTS"
        if why:
            raise ValueError(f"{concept.where}: {why}, or leave it out of COVERAGE.CONCEPTS")
        if optional:
            raise ValueError(
                f"{concept.where}: a number that may not apply needs literals; define them by "
                "ranges of it"
            )
        cuts = sorted(self._cuts[name])
        low = -inf if concept.unit_type in SIGNED or cuts[0] < 0 else 0.0
        return Variable(
            name,
            "continuous",
            self._units[name],
            low,
            inf,
            cuts=tuple(cut for cut in cuts if cut > low),
        )

    def _parents(self) -> list[Statement]:
        """What is absent together, and what is absent unless something else holds."""
        statements = []
        for record in self._list("OPTIONAL"):
            below = self._taxonomy.below("COVERAGE.OPTIONAL", record)
            inside = [name for name in below if name in self._index]
            direct = [name for name in inside if name not in self._deeper(record)]
            for name in inside if direct else []:
                first, missing = self._missing(direct[0]), self._missing(name)
                implied: Expression = Some((Not(first), missing))
                if name in direct:
                    implied = Every((implied, Some((Not(missing), first))))
                statements.append(Statement(f"COVERAGE.OPTIONAL.{record}", implied))
        for child, condition in self._mapping("APPLIES_IF").items():
            holds = self._applies(child, condition, self._meaning)
            for name in self._taxonomy.below("COVERAGE.APPLIES_IF", child):
                if name not in self._index:
                    continue
                missing = self._missing(name)
                either = Every((Some((missing, holds)), Some((Not(missing), Not(holds)))))
                statements.append(Statement(f"COVERAGE.APPLIES_IF.{child}", either))
        return statements

    def _deeper(self, record: str) -> set[str]:
        """The concepts of a record that are in an optional record inside it, or that apply only if
        something else holds.
        """
        inside, deeper = set(self._taxonomy.below("COVERAGE", record)), set()
        for other in (*self._list("OPTIONAL"), *self._mapping("APPLIES_IF")):
            names = set(self._taxonomy.below("COVERAGE", other))
            if other != record and names < inside:
                deeper |= names
        return deeper

    def _missing(self, name: str) -> Expression:
        index = self._index[name]
        return OneOf((index,), frozenset({(self._variables[index].size - 1,)}))

    def _applies(self, child: str, condition: Any, meaning: Meaning) -> Expression:
        where = f"COVERAGE.APPLIES_IF.{child}"
        if not isinstance(condition, dict) or not condition:
            raise ValueError(
                f"{where}: expected conditions such as 'rainfall: [light, heavy]', got "
                f"{shown(condition)}"
            )
        return Every(
            tuple(meaning(f"{where}.{key}", key, plain, False) for key, plain in condition.items())
        )

    def _meaning(self, where: str, key: str, plain: Any, grows: bool) -> Expression:
        """A condition on one concept.

        Where the concept does not apply, the condition never keeps a point outside the ODD.
        """
        name = self._taxonomy.find(where, key)
        concept = self._taxonomy.concepts[name]
        shown_by = (self._ordered(name) or name) if concept.is_number else name
        if shown_by not in self._index:
            raise ValueError(
                f"{where}: {shown_by} is not among COVERAGE.CONCEPTS, so this cannot be checked"
            )
        index = self._index[shown_by]
        variable = self._variables[index]
        literals = self._taxonomy.concepts[shown_by].literals
        inside: set[int] = set()
        for text in plain if isinstance(plain, list) else [plain]:
            if text is None or (text in UNKNOWN and text not in variable.values):
                continue
            with _at(where):
                counted = self._taxonomy.concepts[shown_by]
                inside |= categories_meant(concept, counted, variable, text)
            if grows and NOT_APPLICABLE in variable.values and literals:
                inside.add(variable.size - 1)
        return OneOf((index,), frozenset((category,) for category in inside))


@contextmanager
def _at(where: str) -> Iterator[None]:
    """Adds the place to a ValueError."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
