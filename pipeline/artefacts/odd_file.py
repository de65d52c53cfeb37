"""OpenODD files (ASAM OpenODD 1.0 in YAML), such as a taxonomy of ISO 34503 and the modules of an ODD, as spaces.

Beside the standard's IMPORT, TAXONOMY, MODULES and ODD, a file may have COVERAGE with what coverage needs to know and OpenODD does not say:
CONCEPTS to count, CUTS of numbers, what is OPTIONAL and what APPLIES_IF something else holds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import inf
from pathlib import Path
from typing import Any

from pipeline.artefacts.data_set import NOT_APPLICABLE
from pipeline.artefacts.odd_modules import Modules
from pipeline.artefacts.odd_numbers import SIGNED, Bounds, bounds, in_unit
from pipeline.artefacts.odd_taxonomy import Concept, Taxonomy, literals_within
from pipeline.artefacts.statements import Statement, space_with
from pipeline.artefacts.written_yaml import read_written_yaml
from pipeline.core.expressions import Every, Expression, Not, OneOf, Some
from pipeline.core.names import nearest
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError, shown

KEYS = ("IMPORT", "TAXONOMY", "MODULES", "MODULE", "ODD", "COVERAGE")
COVERAGE = ("CONCEPTS", "CUTS", "OPTIONAL", "APPLIES_IF")
BEGINS = re.compile(rb"^(%s)[ \t]*:" % "|".join(KEYS).encode(), re.MULTILINE)
"""A line that only OpenODD files have."""
UNKNOWN = ("unknown", "none", "null", "undefined")


def read_odd_file(path: Path) -> Space:
    """Read an OpenODD file and what it imports.

    Raises InputError that names the file and the place: for what is wrong, and for what a space cannot say.
    """
    parts: dict[str, dict[str, Any]] = {"TAXONOMY": {}, "MODULES": {}, "ODD": {}, "COVERAGE": {}}
    _read(path, parts, [])
    try:
        return _Odd(parts).space()
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    except RecursionError as error:
        raise InputError(f"{path}: the YAML is nested too deeply") from error


def _read(path: Path, parts: dict[str, dict[str, Any]], read: list[Path]) -> None:
    """Add the sections of a file, after those of its imports."""
    if path.resolve() in read:
        return
    read.append(path.resolve())
    plain = read_written_yaml(path)
    if not isinstance(plain, dict):
        raise InputError(f"{path}: expected a mapping with {', '.join(KEYS)}")
    for key in plain:
        if key not in KEYS:
            raise InputError(f"{path}: {key} is not read{nearest(str(key), KEYS)}")
    imports = plain.get("IMPORT") or []
    if not isinstance(imports, list) or not all(isinstance(name, str) for name in imports):
        raise InputError(f"{path}: IMPORT: expected a list of files, got {shown(imports)}")
    for name in imports:
        _read(path.parent / name, parts, read)
    for key in KEYS[1:]:
        if (section := plain.get(key)) is None:
            continue
        if not isinstance(section, dict):
            raise InputError(f"{path}: {key}: expected a mapping, got {shown(section)}")
        _merge(path, key, parts["MODULES" if key == "MODULE" else key], section)


def _merge(path: Path, where: str, whole: dict[str, Any], part: Mapping[str, Any]) -> None:
    for key, value in part.items():
        place = f"{where}.{key}"
        if key not in whole:
            whole[key] = value
        elif where.startswith("TAXONOMY") and isinstance(whole[key], dict) and isinstance(value, dict):
            _merge(path, place, whole[key], value)
        else:
            raise InputError(f"{path}: {place}: an imported file has this too")


class _Odd:
    def __init__(self, parts: Mapping[str, dict[str, Any]]) -> None:
        self._taxonomy = Taxonomy(parts["TAXONOMY"])
        self._modules = Modules(parts["ODD"], parts["MODULES"])
        self._said = parts["COVERAGE"]
        for key in self._said:
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
        absent = self._absent()
        self._variables = [self._variable(name, self._taxonomy.concepts[name], name in absent) for name in kept]
        if not self._variables:
            raise ValueError("TAXONOMY: expected concepts, got none")
        self._index = {name: index for index, name in enumerate(kept)}
        return space_with(self._variables, [*self._parents(), *self._modules.statements(self._meaning)])

    def _list(self, key: str) -> list[str]:
        found = self._said.get(key) or []
        if not isinstance(found, list) or not all(isinstance(name, str) for name in found):
            raise ValueError(f"COVERAGE.{key}: expected a list of names, got {shown(found)}")
        return found

    def _mapping(self, key: str) -> dict[str, Any]:
        found = self._said.get(key) or {}
        if not isinstance(found, dict):
            raise ValueError(f"COVERAGE.{key}: expected a mapping, got {shown(found)}")
        return found

    def _kept(self) -> list[str]:
        """The concepts that are variables: those chosen, or all but numbers whose ranges define literals."""
        concepts = self._taxonomy.concepts
        bases = {self._base(name) for name, concept in concepts.items() if concept.base}
        if chosen := self._list("CONCEPTS"):
            named = {name for one in chosen for name in self._taxonomy.below("COVERAGE.CONCEPTS", one)}
            named = {(self._ordered(name) or name) if name in bases else name for name in named}
            return [name for name in concepts if name in named]
        return [name for name in concepts if name not in bases]

    def _base(self, name: str) -> str:
        """The number that defines the literals of a concept: the one declared nearest to it."""
        concept = self._taxonomy.concepts[name]
        for depth in reversed(range(len(concept.path))):
            for other, one in self._taxonomy.concepts.items():
                if one.path == (*concept.path[:depth], concept.base) and one.is_number:
                    return other
        return self._taxonomy.find(concept.where, concept.base)

    def _ordered(self, number: str) -> str | None:
        """The concept whose literals are ranges of a number; None if there is none."""
        found = [name for name, concept in self._taxonomy.concepts.items() if concept.base and self._base(name) == number]
        if len(found) > 1:
            raise ValueError(f"{self._taxonomy.concepts[number].where}: expected literals of one concept, got {' and '.join(found)}")
        return found[0] if found else None

    def _collect_cuts(self) -> None:
        """The ends of all bounds that statements set, and the cuts that are asked for."""
        for name, cuts in self._mapping("CUTS").items():
            where = f"COVERAGE.CUTS.{name}"
            if not isinstance(cuts, list) or not all(isinstance(cut, str) for cut in cuts):
                raise ValueError(f"{where}: expected a list such as [30 km/h, 60 km/h], got {shown(cuts)}")
            for cut in cuts:
                own = _at(where, lambda cut=cut: bounds(cut))
                self._cut(where, self._number(where, name), Bounds(own.low, inf, own.unit))
        self._modules.statements(self._cutting)
        for child, condition in self._mapping("APPLIES_IF").items():
            self._applies(child, condition, self._cutting)

    def _number(self, where: str, name: str) -> str:
        found = self._taxonomy.find(where, name)
        if not self._taxonomy.concepts[found].is_number:
            raise ValueError(f"{where}: expected a number, got {found} with {', '.join(self._taxonomy.concepts[found].literals)}")
        return found

    def _cutting(self, where: str, key: str, plain: Any, grows: bool) -> Expression:
        name = self._taxonomy.find(where, key)
        concept = self._taxonomy.concepts[name]
        if concept.is_number and isinstance(plain, str) and plain not in UNKNOWN and self._ordered(name) is None:
            self._cut(where, name, _at(where, lambda: bounds(plain)))
        return Every(())

    def _cut(self, where: str, name: str, own: Bounds) -> None:
        concept = self._taxonomy.concepts[name]
        unit = self._units.setdefault(name, own.unit)
        own = _at(where, lambda: in_unit(own, unit, concept.unit_type))
        cuts = self._cuts.setdefault(name, {})
        for end in _ends(concept, own):
            cuts[end] = None

    def _variable(self, name: str, concept: Concept, optional: bool) -> Variable:
        if concept.literals:
            return Variable(name, "categorical", values=(*concept.literals, *([NOT_APPLICABLE] if optional else [])))
        if not concept.is_number or not self._cuts.get(name):
            why = "a shape file has no categories" if not concept.is_number else "no statement compares this number; give it COVERAGE.CUTS"
            raise ValueError(f"{concept.where}: {why}, or leave it out of COVERAGE.CONCEPTS")
        if optional:
            raise ValueError(f"{concept.where}: a number that may not apply needs literals; define them by ranges of it")
        cuts = sorted(self._cuts[name])
        low = -inf if concept.unit_type in SIGNED or cuts[0] < 0 else 0.0
        return Variable(name, "continuous", self._units[name], low, inf, cuts=tuple(cut for cut in cuts if cut > low))

    def _absent(self) -> set[str]:
        """The concepts that may not apply."""
        named = [*self._list("OPTIONAL"), *self._mapping("APPLIES_IF")]
        return {name for one in named for name in self._taxonomy.below("COVERAGE", one)}

    def _parents(self) -> list[Statement]:
        """What is absent together, and what is absent unless something else holds."""
        found = []
        for record in self._list("OPTIONAL"):
            inside = [name for name in self._taxonomy.below("COVERAGE.OPTIONAL", record) if name in self._index]
            own = [name for name in inside if name not in self._deeper(record)]
            for other in inside if own else []:
                both = Some((Not(self._missing(own[0])), self._missing(other)))
                back = Some((Not(self._missing(other)), self._missing(own[0])))
                together = other in own
                found.append(Statement(f"COVERAGE.OPTIONAL.{record}", Every((both, back)) if together else both))
        for child, condition in self._mapping("APPLIES_IF").items():
            holds = self._applies(child, condition, self._meaning)
            for name in self._taxonomy.below("COVERAGE.APPLIES_IF", child):
                if name in self._index:
                    missing = self._missing(name)
                    found.append(
                        Statement(f"COVERAGE.APPLIES_IF.{child}", Every((Some((missing, holds)), Some((Not(missing), Not(holds))))))
                    )
        return found

    def _deeper(self, record: str) -> set[str]:
        """The concepts of a record that are in an optional record inside it, or that apply only if something else holds."""
        inside = set(self._taxonomy.below("COVERAGE", record))
        others = [one for one in (*self._list("OPTIONAL"), *self._mapping("APPLIES_IF")) if one != record]
        several = [set(self._taxonomy.below("COVERAGE", one)) for one in others]
        return {name for own in several if own < inside for name in own}

    def _missing(self, name: str) -> Expression:
        index = self._index[name]
        return OneOf((index,), frozenset({(self._variables[index].size - 1,)}))

    def _applies(self, child: str, condition: Any, meaning: Any) -> Expression:
        where = f"COVERAGE.APPLIES_IF.{child}"
        if not isinstance(condition, dict) or not condition:
            raise ValueError(f"{where}: expected conditions such as 'rainfall: [light, heavy]', got {shown(condition)}")
        return Every(tuple(meaning(f"{where}.{key}", key, plain, False) for key, plain in condition.items()))

    def _meaning(self, where: str, key: str, plain: Any, grows: bool) -> Expression:
        """A condition on one concept. Where the concept does not apply, the condition never keeps a point outside the ODD."""
        name = self._taxonomy.find(where, key)
        concept = self._taxonomy.concepts[name]
        shown_by = (self._ordered(name) or name) if concept.is_number else name
        if shown_by not in self._index:
            raise ValueError(f"{where}: {shown_by} is not among COVERAGE.CONCEPTS, so this cannot be checked")
        index = self._index[shown_by]
        variable = self._variables[index]
        literals = self._taxonomy.concepts[shown_by].literals
        texts = [text for text in (plain if isinstance(plain, list) else [plain]) if text is not None]
        known = [text for text in texts if text not in UNKNOWN or text in variable.values]
        inside: set[int] = set()
        for text in known:
            inside |= _at(where, lambda text=text: self._categories(concept, variable, text))
        if grows and NOT_APPLICABLE in variable.values and literals and known:
            inside.add(variable.size - 1)
        return OneOf((index,), frozenset((category,) for category in inside))

    def _categories(self, concept: Concept, variable: Variable, text: Any) -> set[int]:
        """The categories of a variable that one expression means."""
        if not isinstance(text, str):
            raise ValueError(f"expected an expression, got {shown(text)}")
        if not concept.is_number:
            return _literals(concept, variable, text)
        own = bounds(text)
        if variable.kind == "categorical":
            ordered = self._taxonomy.concepts[variable.name]
            return set(literals_within(ordered, own, concept.unit_type))
        own = in_unit(own, variable.unit, concept.unit_type)
        ends = _ends(concept, own)
        low, high = (ends[0] if own.low > -inf else -inf), (ends[-1] if own.high < inf else inf)
        if low == high:
            raise ValueError(f"{text} is a single number, which is no category; use a range")
        starts = [variable.low, *(variable.cuts or ())]
        return {part for part, (start, end) in enumerate(zip(starts, [*starts[1:], inf], strict=True)) if low <= start and end <= high}


def _ends(concept: Concept, own: Bounds) -> list[float]:
    """Where categories begin and end so that bounds hold for whole ones: for whole numbers, after a number that is still inside."""
    low = own.low + (1 if concept.whole and own.above else 0)
    high = own.high + (1 if concept.whole and not own.below else 0)
    return [end for end in (low, high) if abs(end) < inf]


def _literals(concept: Concept, variable: Variable, text: str) -> set[int]:
    if text in variable.values:
        return {variable.values.index(text)}
    sign = text[:2].strip("= ") if text[:1] in "<>" else ""
    if sign and concept.ranges:
        literal = text.lstrip("<>= ")
        if literal in concept.literals:
            place, last = concept.literals.index(literal), len(concept.literals)
            including = 1 if text[1:2] == "=" else 0
            return set(range(place + including)) if sign == "<" else set(range(place + 1 - including, last))
    raise ValueError(f"{text!r} is no literal of {variable.name}{nearest(text, variable.values)}")


def _at(where: str, act: Any) -> Any:
    """What `act` gives; its ValueError with the place."""
    try:
        return act()
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
