"""Models of ACTS, NIST's tool for combinatorial testing, as spaces.

It has a text form and an XML form.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from pipeline.artefacts.acts_constraints import TRUTH, Typed, read_constraint
from pipeline.artefacts.statements import Statement, read_text, space_with
from pipeline.core.comparisons import NUMBER
from pipeline.core.names import nearest
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError

HEADER = re.compile(r"^\s*\[System\]", re.IGNORECASE | re.MULTILINE)
"""Begins the text form."""
SECTIONS = ("system", "parameter", "relation", "constraint", "test set")
PARAMETER = re.compile(r"(?P<name>[^(:]+?)\s*(\((?P<kind>[^)]*)\))?\s*:(?P<values>.*)")
KINDS = {"0": "int", "1": "enum", "2": "boolean"}
"""The numbers of the types in the XML form."""
REJECTED = {
    "relation": "relations have strengths of their own; a space has one for all, "
    "given by --strength",
    "test set": "existing tests are no part of a space; name their table by --include",
}

Named = tuple[str, str, str, list[str]]
"""Where a parameter stands, its name, its type and its values."""


def read_acts_model(path: Path) -> Space:
    """Read an ACTS model in either form.

    Raises:
        InputError: naming the file, the place and what a space cannot say: relations, invalid
            values, existing tests.
    """
    text = read_text(path, "an ACTS model")
    return (
        acts_xml_space(text, str(path))
        if text.lstrip().startswith("<")
        else acts_text_space(text, str(path))
    )


def acts_text_space(text: str, name: str) -> Space:
    """The space of a model in ACTS' text form; `name` of the file for errors."""
    section, parameters, constraints = "", [], []
    try:
        for number, line in enumerate(map(str.strip, text.splitlines()), 1):
            where = f"line {number}"
            if not line or line.startswith("--"):
                continue
            if line.startswith("["):
                section = line.strip("[] ").lower()
                if section not in SECTIONS:
                    hint = nearest(section, SECTIONS)
                    raise ValueError(f"{where}: unknown section {line}{hint}")
            elif section in REJECTED:
                raise ValueError(f"{where}: {REJECTED[section]}")
            elif section == "parameter":
                match = PARAMETER.fullmatch(line)
                if match is None:
                    raise ValueError(
                        f"{where}: expected a parameter such as 'speed (int) : 1, 2, 3', got "
                        f"{line!r}"
                    )
                if ";" in match["values"]:
                    raise ValueError(
                        f"{where}: {match['name']} has invalid values after the ';', which a space "
                        "does not have"
                    )
                kind = (match["kind"] or "").strip().lower()
                values = [value.strip() for value in match["values"].split(",")]
                parameters.append((where, match["name"], kind, values))
            elif section == "constraint":
                constraints.append((where, line))
            elif section != "system":
                raise ValueError(f"{where}: expected [System] before anything else, got {line!r}")
        return _space(parameters, constraints)
    except ValueError as error:
        raise InputError(f"{name}: {error}") from error


def acts_xml_space(text: str, name: str) -> Space:
    """The space of a model in ACTS' XML form; `name` of the file for errors."""
    try:
        root = ET.fromstring(text)
        if root.tag != "System":
            raise ValueError(f"expected the element System, got {root.tag}")
        for path, why in (("Relations/Relation", "relation"), ("Testset/*", "test set")):
            if any(part.get("Default") != "true" for part in root.findall(path)):
                raise ValueError(f"System/{path}: {REJECTED[why]}")
        parameters = []
        for index, element in enumerate(root.findall("Parameters/Parameter"), 1):
            where, parameter = f"Parameter[{index}]", element.get("name") or ""
            kind = element.get("type") or ""
            if not parameter or (kind and kind not in KINDS):
                raise ValueError(
                    f"{where}: expected a name and a type from 0 to 2 (int, enum, boolean), got "
                    f"name {parameter!r} and type {kind!r}"
                )
            if element.findall("invalidValues/*"):
                raise ValueError(
                    f"{where}: {parameter} has invalid values, which a space does not have"
                )
            values = [(value.text or "").strip() for value in element.findall("values/value")]
            parameters.append((where, parameter, KINDS.get(kind, ""), values))
        constraints = [
            (f"Constraint[{i}]", element.get("text") or "")
            for i, element in enumerate(root.findall("Constraints/Constraint"), 1)
        ]
        return _space(parameters, constraints)
    except ET.ParseError as error:
        raise InputError(f"{name}: not valid XML ({error})") from error
    except ValueError as error:
        raise InputError(f"{name}: {error}") from error


def _space(parameters: Sequence[Named], constraints: Sequence[tuple[str, str]]) -> Space:
    if not parameters:
        raise ValueError("expected parameters, got none")
    typed: dict[str, Typed] = {}
    variables = []
    for where, name, kind, values in parameters:
        if name in typed:
            raise ValueError(f"{where}: the parameter {name} appears twice")
        if not all(values) or len(set(values)) != len(values):
            raise ValueError(
                f"{where}: the values of {name} must be distinct and not empty, got "
                f"{', '.join(values)}"
            )
        typed[name] = _typed(where, name, kind, values)
        variables.append(Variable(name, "categorical", values=tuple(values)))
    statements = []
    for where, text in constraints:
        try:
            statements.append(Statement(where, read_constraint(text, list(typed.values()))))
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
    return space_with(variables, statements)


def _typed(where: str, name: str, kind: str, values: list[str]) -> Typed:
    numeric = all(map(NUMBER.fullmatch, values))
    truth = all(value.lower() in TRUTH for value in values)
    if not kind and numeric:
        kind = "int"
    elif not kind:
        kind = "boolean" if truth else "enum"
    if kind not in KINDS.values():
        raise ValueError(f"{where}: the type of {name} must be int, enum or boolean, got {kind!r}")
    if (kind == "int" and not numeric) or (kind == "boolean" and not truth):
        expected = "numbers" if kind == "int" else "true and false"
        raise ValueError(
            f"{where}: expected {expected} as values of {name}, got {', '.join(values)}"
        )
    if kind == "enum":
        return Typed(name, tuple(values))
    return Typed(
        name, tuple(float(value) if kind == "int" else TRUTH[value.lower()] for value in values)
    )
