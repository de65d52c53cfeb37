"""Writes a space as a PICT model, an ACTS model or a space file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from pipeline.artefacts.acts_export import acts_text, acts_xml
from pipeline.artefacts.acts_model import acts_text_space, acts_xml_space
from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.pict_export import pict_text
from pipeline.artefacts.pict_model import pict_space
from pipeline.artefacts.statements import category_names
from pipeline.core.constraints import Clause
from pipeline.core.expressions import Expression, Not, OneOf, Some, clauses_of
from pipeline.core.names import nearest
from pipeline.core.sequences import SequenceSpace
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError

SUFFIXES = {".txt": "pict", ".xml": "acts-xml", ".yaml": "space", ".yml": "space"}


def format_of(path: Path, given: str | None) -> str:
    """The format to write: the given one, or that of the file's suffix.

    Raises:
        InputError: if neither says.
    """
    kind = given or SUFFIXES.get(path.suffix.lower())
    if kind is None:
        raise InputError(
            f"{path}: expected a name that ends in {', '.join(SUFFIXES)}, or "
            f"--format{nearest(path.suffix, SUFFIXES)}"
        )
    return kind


def write_model(path: Path, space: Space, kind: str) -> list[str]:
    """Write a space; returns what the format cannot say and so is left out.

    Before writing, the text is read back.

    Raises:
        InputError: naming the variable that the format cannot write.
    """
    writers: Mapping[str, tuple[Callable[[Space], str], Callable[[str, str], Space] | None]] = {
        "pict": (pict_text, pict_space),
        "acts": (acts_text, acts_text_space),
        "acts-xml": (acts_xml, acts_xml_space),
        "space": (_space_file, None),
    }
    write, read = writers[kind]
    text = write(space)
    if read is not None:
        back = read(text, str(path))
        for variable, again in zip(space.variables, back.variables, strict=False):
            if (variable.name, category_names(variable)) != (again.name, again.values):
                raise InputError(
                    f"{path}: {variable.name}: {kind} cannot write this name or its values "
                    f"{', '.join(variable.labels)}"
                )
        if len(space) != len(back) or _meaning(space) != _meaning(back):
            raise InputError(
                f"{path}: {kind} cannot write this space, because the file would be read as "
                "another one"
            )
    write_bytes(path, text.encode())
    return _left_out(space, kind)


def _meaning(space: Space) -> frozenset[Clause]:
    """The clauses without repeated ones, repeated literals and clauses that always hold."""
    clauses: set[Clause] = set()
    for clause in space.constraints.clauses:
        parts: list[Expression] = []
        for literal in clause:
            equal = OneOf((literal.variable,), frozenset({(literal.category,)}))
            parts.append(equal if literal.equal else Not(equal))
        clauses.update(clauses_of(Some(tuple(parts)), space.sizes))
    return frozenset(clauses)


def _left_out(space: Space, kind: str) -> list[str]:
    """Weights that the format lacks, what tells numbers from names, and what makes points of
    frames.
    """
    missing = []
    if isinstance(space, SequenceSpace):
        missing.append(f"the frames and the rules of {', '.join(space.rules)}")
    for variable in space.variables:
        weights = variable.weights or (1,)
        if kind.startswith("acts") and set(weights) != {1}:
            missing.append(f"the weights of {variable.name}")
        elif kind == "pict" and 0 in weights:
            missing.append(f"the weights of 0 of {variable.name}")
        if kind != "space" and variable.kind != "categorical":
            missing.append(
                f"that {variable.name} is a number; its parts become names such as "
                f"{category_names(variable)[0]}"
            )
    if kind != "space":
        missing += [f"the named planes {named.name}" for named in space.extras.planes]
        missing += ["the single combinations"] if space.extras.combinations else []
    return missing


def _space_file(space: Space) -> str:
    plain: dict[str, Any] = {
        "variables": {variable.name: _body(variable) for variable in space.variables}
    }
    if space.clauses:
        plain["constraints"] = [
            clause if isinstance(clause, str) else list(clause) for clause in space.clauses
        ]
    for named in space.extras.planes:
        conditions = [space.names[variable] for variable in named.variables]
        plane = {"conditions": conditions, "strength": named.strength}
        plain.setdefault("planes", {})[named.name] = plane
    for combination in space.extras.combinations:
        categories: dict[str, str] = {}
        for index, category in zip(combination.variables, combination.categories, strict=True):
            categories[space.names[index]] = space.variables[index].labels[category]
        entry = {"of": categories, "weight": combination.weight}
        plain.setdefault("combinations", []).append(entry)
    return str(
        yaml.safe_dump(
            plain, sort_keys=False, allow_unicode=True, default_flow_style=None, width=140
        )
    )


def _body(variable: Variable) -> dict[str, Any]:
    if variable.kind == "categorical":
        body: dict[str, Any] = {"values": list(variable.values)}
    else:
        body = {
            "interval": [_number(variable.low), _number(variable.high)],
            "cuts": [_number(cut) for cut in variable.cuts or ()],
        }
        if variable.cyclic:
            body["cyclic"] = True
    if variable.unit:
        body["unit"] = variable.unit
    weighted = zip(variable.labels, variable.weights, strict=False)
    weights = {label: weight for label, weight in weighted if weight != 1}
    if weights:
        body["weights"] = weights
    return body


def _number(number: float) -> float | int:
    return int(number) if float(number).is_integer() else float(number)
