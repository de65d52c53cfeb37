"""Spaces as models of ACTS, in its text form and its XML form."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

from pipeline.artefacts.acts_constraints import TRUTH
from pipeline.artefacts.acts_model import KINDS
from pipeline.artefacts.statements import category_names
from pipeline.core.constraints import Clause
from pipeline.core.space import Space
from pipeline.errors import InputError

NAME = re.compile(r"[^\W\d]\w*")
INTEGER = re.compile(r"-?\d{1,9}")


def _kind(values: tuple[str, ...]) -> str:
    if all(map(INTEGER.fullmatch, values)) and len(set(map(int, values))) == len(values):
        return "int"
    return "boolean" if sorted(value.lower() for value in values) == sorted(TRUTH) else "enum"


def _parameters(space: Space) -> list[tuple[str, str, tuple[str, ...]]]:
    """Name, type and values of each parameter; InputError for what ACTS cannot write."""
    for variable in space.variables:
        if not NAME.fullmatch(variable.name) or variable.name.lower() in TRUTH:
            raise InputError(
                f"{variable.name}: the name of an ACTS parameter consists of letters, digits and _"
            )
        for value in category_names(variable):
            if (
                not value
                or value != value.strip()
                or re.search(r'[,;"\n\r]', value)
                or not value.isprintable()
            ):
                raise InputError(f"{variable.name}: ACTS cannot write the value {value!r}")
    return [
        (variable.name, _kind(category_names(variable)), category_names(variable))
        for variable in space.variables
    ]


def _constraint(space: Space, clause: Clause) -> str:
    parts = []
    for literal in clause:
        variable = space.variables[literal.variable]
        value = category_names(variable)[literal.category]
        shown = f'"{value}"' if _kind(category_names(variable)) == "enum" else value
        parts.append(f"{variable.name} {'=' if literal.equal else '!='} {shown}")
    return " || ".join(parts)


def acts_text(space: Space) -> str:
    lines = ["[System]", "Name: space", "", "[Parameter]"]
    lines += [f"{name} ({kind}) : {', '.join(values)}" for name, kind, values in _parameters(space)]
    if space.clauses:
        lines += [
            "",
            "[Constraint]",
            *(_constraint(space, clause) for clause in space.constraints.clauses),
        ]
    return "\n".join(lines) + "\n"


def acts_xml(space: Space) -> str:
    root = ET.Element("System", name="space")
    parameters = ET.SubElement(root, "Parameters")
    numbers = {kind: number for number, kind in KINDS.items()}
    for index, (name, kind, values) in enumerate(_parameters(space)):
        element = ET.SubElement(
            parameters, "Parameter", id=str(index), name=name, type=numbers[kind]
        )
        several = ET.SubElement(element, "values")
        for value in values:
            ET.SubElement(several, "value").text = value
        ET.SubElement(element, "basechoices")
        ET.SubElement(element, "invalidValues")
    ET.SubElement(root, "OutputParameters")
    ET.SubElement(root, "Relations")
    constraints = ET.SubElement(root, "Constraints")
    for clause in space.constraints.clauses:
        element = ET.SubElement(constraints, "Constraint", text=_constraint(space, clause))
        named = ET.SubElement(element, "Parameters")
        for variable in dict.fromkeys(literal.variable for literal in clause):
            ET.SubElement(named, "Parameter", name=space.names[variable])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
