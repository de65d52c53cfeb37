"""A space of variables and of statements that a foreign file makes about them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from pipeline.core.constraints import Literal, parse_literal
from pipeline.core.expressions import MOST_ROWS, Expression, OneOf, clauses_of
from pipeline.core.space import Space, Variable
from pipeline.errors import InputError


@dataclass(frozen=True)
class Statement:
    """An expression that holds for every point, and its place in the file, such as 'line 7'."""

    where: str
    expression: Expression


def space_with(variables: Sequence[Variable], statements: Sequence[Statement]) -> Space:
    """The space in which all statements hold.

    Raises:
        ValueError: naming the statement that no clauses can say.
    """
    sizes = [variable.size for variable in variables]
    clauses: dict[tuple[str, ...], None] = {}
    for statement in statements:
        try:
            for clause in clauses_of(statement.expression, sizes):
                clauses[tuple(literal_text(variables, literal) for literal in clause)] = None
        except ValueError as error:
            raise ValueError(f"{statement.where}: {error}") from error
    return Space(tuple(variables), tuple(clauses))


def literal_text(variables: Sequence[Variable], literal: Literal) -> str:
    """A literal as a space file writes it; ValueError for a name that cannot be in one."""
    variable = variables[literal.variable]
    label = variable.labels[literal.category]
    text = f"{variable.name} {'=' if literal.equal else '!='} {label}"
    try:
        meant = parse_literal(text, {variable.name: variable.labels})
    except ValueError:
        meant = None
    if meant != Literal(0, literal.category, literal.equal):
        raise ValueError(
            "names in constraints must not contain '=' or '!=', or have spaces at their ends, got "
            f"{variable.name!r} and {label!r}"
        )
    return text


def category_names(variable: Variable) -> tuple[str, ...]:
    """Names of the categories without commas, which separate values in models.

    For example, [0, 20) becomes [0 .. 20).
    """
    if variable.kind == "categorical":
        return variable.labels
    return tuple(label.replace(", ", " .. ") for label in variable.labels)


def rows_where(variables: Sequence[int], sizes: Sequence[int], test: Callable[..., Any]) -> OneOf:
    """The combinations for which `test`, called with the categories of the variables, is true.

    Args:
        sizes: number of categories of each of these variables.

    Raises:
        ValueError: if there are too many combinations to try.
    """
    if (count := prod(sizes)) > MOST_ROWS:
        raise ValueError(
            f"it compares variables with {count:,} combinations, more than {MOST_ROWS:,}"
        )
    return OneOf(
        tuple(variables), frozenset(row for row in product(*map(range, sizes)) if test(*row))
    )


def read_text(path: Path, expected: str) -> str:
    """The text of a file; InputError if it is missing, unreadable or not UTF-8."""
    try:
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: expected {expected}, got {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected {expected} in UTF-8, got {error}") from error
