"""The modules of an OpenODD file (ASAM OpenODD 1.0, sections 6.4 and 10.4).

Their INCLUDE and EXCLUDE sections become expressions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pipeline.artefacts.statements import Statement
from pipeline.core.expressions import Every, Expression, Not, Some
from pipeline.core.names import nearest
from pipeline.errors import shown

SECTIONS = ("INCLUDE_AND", "INCLUDE_OR", "EXCLUDE_AND", "EXCLUDE_OR")
FOR_PEOPLE = ("TITLE", "DESCRIPTION", "COMMENT", "METADATA", "TAGS", "TAG")
"""What a module says to people."""
KEYS = (*SECTIONS, *FOR_PEOPLE, "ACTIVE", "LABEL", "LABELS")
TRUTH = {"true": True, "false": False}

Meaning = Callable[[str, str, Any, bool], Expression]
"""From the place of a condition, its concept, its expression, and whether the ODD grows where the
condition holds."""


class Modules:
    """All modules by name.

    The entry points are those under ODD or, without ODD, all to which no other module refers.
    """

    def __init__(self, odd: Mapping[str, Any], others: Mapping[str, Any]) -> None:
        """Check the modules.

        Raises:
            ValueError: naming a module with an unknown key, two sections of a kind, or none.
        """
        self._all = {str(name): plain for name, plain in (*odd.items(), *others.items())}
        if len(self._all) < len(odd) + len(others):
            raise ValueError(
                f"{_where(next(name for name in odd if name in others))}: this module appears twice"
            )
        self._labels: dict[str, list[str]] = {}
        for name, plain in self._all.items():
            where = _where(name)
            if not isinstance(plain, dict):
                raise ValueError(
                    f"{where}: expected INCLUDE_AND, INCLUDE_OR, EXCLUDE_AND or EXCLUDE_OR, got "
                    f"{shown(plain)}"
                )
            for key in plain:
                if key not in KEYS:
                    raise ValueError(f"{where}: unknown key '{key}'{nearest(str(key), KEYS)}")
            for kind in ("INCLUDE", "EXCLUDE"):
                if f"{kind}_AND" in plain and f"{kind}_OR" in plain:
                    raise ValueError(
                        f"{where}: expected at most one {kind} section, got {kind}_AND and "
                        f"{kind}_OR"
                    )
            if not any(key in plain for key in SECTIONS):
                raise ValueError(f"{where}: expected at least one of {', '.join(SECTIONS)}")
            given = plain.get("LABELS", plain.get("LABEL", []))
            labels = [given] if isinstance(given, str) else given
            if not isinstance(labels, list) or not all(isinstance(label, str) for label in labels):
                raise ValueError(
                    f"{where}.LABELS: expected a name or a list of names, got {shown(given)}"
                )
            for label in labels:
                self._labels.setdefault(label, []).append(name)
        self._candidates = list(map(str, odd)) or list(self._all)

    def statements(self, meaning: Meaning) -> list[Statement]:
        """A statement for each entry point; ValueError that names the place of what is wrong."""
        referred = {key for plain in self._all.values() for key in _keys(plain)}
        referred |= {name for label in referred for name in self._labels.get(label, ())}
        roots = [name for name in self._candidates if name not in referred]
        if self._all and not roots:
            raise ValueError(
                "MODULES: another module refers to each of them; leave at least one that none "
                f"refers to: {', '.join(self._candidates)}"
            )
        statements = []
        for name in roots:
            expression = self._module(name, meaning, True, ())
            if expression is not None:
                statements.append(Statement(_where(name), expression))
        return statements

    def _module(
        self, name: str, meaning: Meaning, grows: bool, within: tuple[str, ...]
    ) -> Expression | None:
        """INCLUDE and not EXCLUDE; None for a module that is not active.

        Args:
            grows: whether the ODD grows where the module holds.
        """
        if name in within:
            raise ValueError(
                f"{_where(name)}: this module refers to itself, by "
                f"{' → '.join((*within[within.index(name) :], name))}"
            )
        plain = self._all[name]
        if not _flag(f"{_where(name)}.ACTIVE", plain.get("ACTIVE", "true")):
            return None
        parts = []
        for key in SECTIONS:
            if key in plain:
                include = key.startswith("INCLUDE")
                section = self._section(
                    f"{_where(name)}.{key}",
                    plain[key],
                    key[-3:].strip("_"),
                    meaning,
                    grows is include,
                    (*within, name),
                )
                parts.append(section if include or section is None else Not(section))
        return Every(tuple(part for part in parts if part is not None))

    def _section(
        self,
        where: str,
        plain: Any,
        operator: str,
        meaning: Meaning,
        grows: bool,
        within: tuple[str, ...],
    ) -> Expression | None:
        if not isinstance(plain, dict) or not plain:
            raise ValueError(
                f"{where}: expected conditions such as 'wind_speed: \"< 40 km/h\"', got "
                f"{shown(plain)}"
            )
        parts: list[Expression | None] = []
        for key, value in plain.items():
            place = f"{where}.{key}"
            if key in ("AND", "OR"):
                if key == operator:
                    raise ValueError(f"{place}: expected the other operator inside {operator}")
                parts.append(self._section(place, value, key, meaning, grows, within))
            elif key in self._all or key in self._labels:
                # A module or any of the modules with a label, which must hold or must not.
                holds = _flag(place, value)
                several = [key] if key in self._all else self._labels[key]
                referred = []
                for name in several:
                    module = self._module(name, meaning, grows is holds, within)
                    if module is not None:
                        referred.append(module)
                if referred:
                    either = Some(tuple(referred))
                    parts.append(either if holds else Not(either))
            elif key != "METADATA":
                parts.append(meaning(place, str(key), value, grows))
        active = tuple(part for part in parts if part is not None)
        if not active:
            return None
        return Every(active) if operator == "AND" else Some(active)


def _where(name: str) -> str:
    return f"MODULES.{name}"


def _keys(plain: Any) -> set[str]:
    """All keys of the sections of a module."""
    if not isinstance(plain, dict):
        return set()
    return {str(key) for key in plain} | {key for value in plain.values() for key in _keys(value)}


def _flag(where: str, value: Any) -> bool:
    if not isinstance(value, str) or value not in TRUTH:
        raise ValueError(f"{where}: expected true or false, got {shown(value)}")
    return TRUTH[value]
