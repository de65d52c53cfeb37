"""Models of PICT, Microsoft's tool for pairwise testing, as spaces.

The format is that of PICT's public documentation: parameters, sub-models, constraints, in this
order.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NoReturn

from pipeline.artefacts.pict_constraints import read_constraints
from pipeline.artefacts.statements import read_text, space_with
from pipeline.core.space import Space, Variable
from pipeline.core.variable import HEAVIEST
from pipeline.errors import InputError

SUB_MODEL = re.compile(r"\{.*\}")
CONSTRAINT = re.compile(
    r"IF|IF.*\[.*\].*|(NOT\b)?\s*\(?\s*\[.*\].*|\(.*\[.*\].*|(IF|NOT)?.*\bIS(NEG|POSI)ATIVE.*"
    r"|IF\s*\(.*",
    re.IGNORECASE,
)
"""A line that begins the constraints."""
WEIGHT = re.compile(r"(?P<value>.*)\((?P<weight>\s*\d+\s*)\)", re.DOTALL)
ORDER = re.compile(r".*@\s*\d+")


def read_pict_model(path: Path) -> Space:
    """Read a PICT model.

    The first name of a value is its category; its weight is the category's.

    Raises:
        InputError: naming the file, the line and what a space cannot say: sub-models, negative
            values, result parameters, parameters with an order of their own.
    """
    return pict_space(read_text(path, "a PICT model"), str(path))


def pict_space(text: str, name: str) -> Space:
    """The space of the text of a model; `name` of the file for errors."""
    lines = text.splitlines()
    try:
        parameters: dict[str, Variable] = {}
        start = len(lines)  # The first line of the constraints.
        for index, line in enumerate(map(str.strip, lines)):
            if not line or line.startswith("#"):
                continue
            if SUB_MODEL.match(line):
                _reject(
                    index,
                    f"the sub-model {line} has a strength of its own; a space has one for all, "
                    "given by --strength",
                )
            if CONSTRAINT.fullmatch(line):
                start = index
                break
            variable = _parameter(index, line, parameters)
            if variable.name.upper() in parameters:
                _reject(index, f"the parameter {variable.name} appears twice")
            parameters[variable.name.upper()] = variable
        if not parameters:
            raise ValueError("expected parameters such as 'Size: 1, 2, 3', got none")
        variables = list(parameters.values())
        rest = [""] * start + [
            "" if line.lstrip().startswith("#") else line for line in lines[start:]
        ]
        return space_with(variables, read_constraints("\n".join(rest), variables))
    except ValueError as error:
        raise InputError(f"{name}: {error}") from error


def _parameter(index: int, line: str, parameters: dict[str, Variable]) -> Variable:
    name, sign, rest = line.partition(":" if ":" in line else ",")
    name = name.strip()
    if not sign or not name:
        _reject(index, f"expected a parameter such as 'Size: 1, 2, 3', got {line!r}")
    if name.startswith("$"):
        _reject(index, f"{name} is a result parameter, which a space does not have")
    if ORDER.fullmatch(name):
        _reject(
            index,
            f"the parameter {name} has a strength of its own; a space has one for all, given by "
            "--strength",
        )
    values: dict[str, int] = {}
    for text in map(str.strip, rest.split(",")):
        reference = None
        if text[:1] == "<" and text[-1:] == ">":
            reference = parameters.get(text[1:-1].strip().upper())
        if reference is not None:
            weighted = list(zip(reference.values, reference.weights, strict=True))
        else:
            # The first name of the value, and its weight.
            weight = 1
            if (match := WEIGHT.fullmatch(text)) and int(match["weight"]) > 0:
                text, weight = match["value"].strip(), int(match["weight"])
            if weight > HEAVIEST:
                _reject(index, f"the weight of {text} must be at most {HEAVIEST}, got {weight}")
            if text.startswith("~"):
                _reject(
                    index,
                    f"{text} is a negative value, which a space does not have; remove it, or its ~ "
                    "to count it as any other",
                )
            weighted = [(text.split("|")[0].strip(), weight)]
        for value, weight in weighted:
            if value in values:
                _reject(index, f"the value {value!r} of {name} appears twice")
            values[value] = weight
    return Variable(name, "categorical", values=tuple(values), weights=tuple(values.values()))


def _reject(index: int, text: str) -> NoReturn:
    raise ValueError(f"line {index + 1}: {text}")
