"""Spaces as models of PICT."""

from __future__ import annotations

import re

from pipeline.artefacts.pict_constraints import comparable, is_numeric
from pipeline.artefacts.pict_model import pict_space
from pipeline.artefacts.statements import category_names
from pipeline.core.constraints import Clause, Literal
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError


def pict_text(space: Space) -> str:
    lines = [_parameter(variable) for variable in space.variables]
    return (
        "\n".join(
            [*lines, "", *(_constraint(space, clause) for clause in space.constraints.clauses)]
        )
        + "\n"
    )


def _parameter(variable: Variable) -> str:
    weights = variable.weights or (1,) * variable.size
    values = [
        name if weight in (0, 1) else f"{name} ({weight})"
        for name, weight in zip(category_names(variable), weights, strict=True)
    ]
    line = f"{variable.name}: {', '.join(values)}"
    expected = (variable.name, category_names(variable), tuple(weight or 1 for weight in weights))
    try:
        read = pict_space(line, "").variables
        same = "<" not in line and [
            (again.name, again.values, again.weights) for again in read
        ] == [expected]
    except InputError:
        same = False
    if not same:
        raise InputError(
            f"{variable.name}: PICT cannot write this name or its values "
            f"{', '.join(variable.labels)}"
        )
    return line


def _constraint(space: Space, clause: Clause) -> str:
    parts = []
    grouped: dict[tuple[int, bool], list[Literal]] = {}
    for literal in clause:
        grouped.setdefault((literal.variable, literal.equal), []).append(literal)
    for (index, equal), literals in grouped.items():
        variable = space.variables[index]
        compared = comparable(category_names(variable))
        if len(set(compared)) < len(compared):
            raise InputError(
                f"{variable.name}: PICT treats some of the values {', '.join(variable.labels)} as "
                "the same"
            )
        several = [category_names(variable)[literal.category] for literal in literals]
        texts = (
            several
            if is_numeric(category_names(variable))
            else ['"' + re.sub(r'(["\]\\])', r"\\\1", text) + '"' for text in several]
        )
        name = "[" + re.sub(r'(["\]\\])', r"\\\1", variable.name) + "]"
        if equal and len(texts) > 1:
            parts.append(f"{name} IN {{{', '.join(texts)}}}")
        else:
            parts += [f"{name} {'=' if equal else '<>'} {text}" for text in texts]
    return " OR ".join(parts) + ";"
