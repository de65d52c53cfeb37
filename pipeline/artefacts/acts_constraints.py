"""Constraints of ACTS models.

They combine comparisons of parameters, computed by +, -, * and %, with =>, ||, && and !.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import fmod
from typing import Any

from pipeline.artefacts.statements import rows_where
from pipeline.core.expressions import Every, Expression, Not, Some
from pipeline.core.names import nearest

TOKEN = re.compile(
    r"""\s*(?:(?P<text>"[^"]*")|(?P<number>\d+\.?\d*|\.\d+)|(?P<name>[^\W\d]\w*)|"""
    r"""(?P<sign>=>|&&|\|\||==|!=|<=|>=|[=<>!+\-*/%()]))"""
)
COMPARED: dict[str, Callable[[Any, Any], Any]] = {
    "=": operator.eq,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def _remainder(first: float, second: float) -> float:
    """As Java, in which ACTS is written, computes it: with the sign of the first number."""
    if not second:
        raise ValueError("a number modulo 0 is undefined")
    return fmod(first, second)


COMPUTED: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "%": _remainder,
}
TRUTH = {"true": True, "false": False}
KINDS = {float: "a number", bool: "a truth value", str: "a text"}
END = ("end", "the end")


@dataclass(frozen=True)
class Typed:
    """A parameter with its values as ACTS compares them: all float, all bool or all str."""

    name: str
    values: tuple[Any, ...]


@dataclass(frozen=True)
class Operand:
    """A number, text or truth value.

    `compute` takes the values of the parameters, in their order.
    """

    kind: type
    parameters: tuple[int, ...]
    compute: Callable[..., Any]


def read_constraint(text: str, parameters: Sequence[Typed]) -> Expression:
    """One constraint; ValueError that says what was expected and what came."""
    parser = _Parser(_tokens(text), parameters)
    try:
        constraint = parser.condition(parser.implication())
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if parser.next != END:
        raise ValueError(f"expected an operator or the end, got {parser.next[1]}")
    return constraint


def _tokens(text: str) -> list[tuple[str, str]]:
    tokens, place, text = [], 0, text.strip()
    while place < len(text):
        if (match := TOKEN.match(text, place)) is None:
            raise ValueError(
                "expected names, numbers, texts in double quotes and operators, got "
                f"{text[place : place + 20].strip()!r}"
            )
        tokens.append((str(match.lastgroup), match[0].strip()))
        place = match.end()
    return [*tokens, END]


class _Parser:
    def __init__(self, tokens: list[tuple[str, str]], parameters: Sequence[Typed]) -> None:
        self._tokens, self._parameters = iter(tokens), parameters
        self._index = {parameter.name: index for index, parameter in enumerate(parameters)}
        self.next = next(self._tokens)

    def implication(self) -> Expression | Operand:
        first = self._joined("||", Some, lambda: self._joined("&&", Every, self._comparison))
        if not self._sign("=>"):
            return first
        return Some((Not(self.condition(first)), self.condition(self.implication())))

    def condition(self, part: Expression | Operand) -> Expression:
        """A part that must be true or false."""
        if not isinstance(part, Operand):
            return part
        if part.kind is not bool:
            raise ValueError(f"expected a comparison before {self.next[1]}, got {KINDS[part.kind]}")
        return self._rows(part, Operand(bool, (), lambda: True), operator.eq)

    def _joined(
        self, sign: str, join: type[Some] | type[Every], part: Callable[[], Expression | Operand]
    ) -> Expression | Operand:
        """One part, or several with a sign between them."""
        parts = [part()]
        while self._sign(sign):
            parts.append(part())
        return parts[0] if len(parts) == 1 else join(tuple(map(self.condition, parts)))

    def _comparison(self) -> Expression | Operand:
        first = self._computed("+-", lambda: self._computed("*%/", self._single))
        if self.next[0] != "sign" or self.next[1] not in COMPARED:
            return first
        sign = self._take()
        second = self._computed("+-", lambda: self._computed("*%/", self._single))
        if not isinstance(first, Operand) or not isinstance(second, Operand):
            raise ValueError(
                f"expected a parameter or a value on both sides of {sign}, got a condition"
            )
        if first.kind is not second.kind or (
            first.kind is not float and sign not in ("=", "==", "!=")
        ):
            raise ValueError(
                f"{KINDS[first.kind]} and {KINDS[second.kind]} cannot be compared by {sign}"
            )
        return self._rows(first, second, COMPARED[sign])

    def _computed(
        self, signs: str, part: Callable[[], Expression | Operand]
    ) -> Expression | Operand:
        first = part()
        while self.next[0] == "sign" and self.next[1] in signs:
            if (sign := self._take()) == "/":
                raise ValueError(
                    "the division / is not read, because ACTS rounds it; multiply the other side "
                    "instead"
                )
            second = part()
            if (
                not isinstance(first, Operand)
                or not isinstance(second, Operand)
                or {first.kind, second.kind} != {float}
            ):
                raise ValueError(f"expected numbers on both sides of {sign}")
            first = _combined(first, second, COMPUTED[sign])
        return first

    def _single(self) -> Expression | Operand:
        if self._sign("!"):
            return Not(self.condition(self._single()))
        if self._sign("-"):
            number = self._single()
            if not isinstance(number, Operand) or number.kind is not float:
                raise ValueError("expected a number after -")
            return _combined(Operand(float, (), lambda: 0.0), number, operator.sub)
        if self._sign("("):
            inside = self.implication()
            if not self._sign(")"):
                raise ValueError(f"expected ')', got {self.next[1]}")
            return inside
        kind, text = self.next
        if kind not in ("text", "number", "name"):
            raise ValueError(f"expected a parameter or a value, got {text}")
        self._take()
        if kind == "name" and text in self._index:
            parameter = self._index[text]
            values = self._parameters[parameter].values
            return Operand(type(values[0]), (parameter,), lambda value: value)
        if kind == "name" and text.lower() not in TRUTH:
            raise ValueError(f"there is no parameter {text}{nearest(text, self._index)}")
        value: Any = text[1:-1]
        if kind == "name":
            value = TRUTH[text.lower()]
        elif kind == "number":
            value = float(text)
        return Operand(type(value), (), lambda: value)

    def _rows(
        self, first: Operand, second: Operand, relation: Callable[[Any, Any], Any]
    ) -> Expression:
        both = _combined(first, second, relation)
        if not both.parameters:
            return Every(()) if both.compute() else Some(())
        values = [self._parameters[parameter].values for parameter in both.parameters]
        return rows_where(
            both.parameters,
            [len(domain) for domain in values],
            lambda *row: both.compute(*map(operator.getitem, values, row)),
        )

    def _sign(self, sign: str) -> bool:
        if self.next != ("sign", sign):
            return False
        self._take()
        return True

    def _take(self) -> str:
        taken, self.next = self.next, next(self._tokens, END)
        return taken[1]


def _combined(first: Operand, second: Operand, compute: Callable[[Any, Any], Any]) -> Operand:
    """Computed from two operands, which may share parameters."""
    parameters = tuple(dict.fromkeys((*first.parameters, *second.parameters)))

    def computed(*values: Any) -> Any:
        value_of = dict(zip(parameters, values, strict=True)).__getitem__
        return compute(
            first.compute(*map(value_of, first.parameters)),
            second.compute(*map(value_of, second.parameters)),
        )

    return Operand(first.kind, parameters, computed)
