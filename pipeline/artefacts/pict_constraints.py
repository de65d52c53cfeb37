"""Constraints of PICT models.

They combine comparisons with IF, THEN, ELSE, AND, OR, NOT, IN and LIKE.

PICT compares texts without regard to case, and numbers only where all values of a parameter are
numbers.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.artefacts.statements import Statement, rows_where
from pipeline.core.comparisons import NUMBER
from pipeline.core.expressions import Every, Expression, Not, Some
from pipeline.core.names import nearest
from pipeline.core.space import Variable

TOKEN = re.compile(
    r"""(?P<name>\[(?:\\.|[^\]\\])*\])|(?P<text>"(?:\\.|[^"\\])*")
    |(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
    |(?P<sign><>|<=|>=|[=<>(){},;])|(?P<word>[A-Za-z]+)""",
    re.VERBOSE | re.ASCII,
)
RELATIONS: dict[str, Callable[[Any, Any], Any]] = {
    "=": operator.eq,
    "<>": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True)
class Token:
    """A token of a constraint.

    Attributes:
        kind: name of the group in TOKEN, or 'end'.
        text: for a name or text without its marks; a word in capitals.
    """

    kind: str
    text: str
    line: int


def read_constraints(text: str, variables: Sequence[Variable]) -> list[Statement]:
    """The constraints in a text whose lines are those of the file, empty where something else
    stands.

    Raises:
        ValueError: naming the line and what was expected.
    """
    parser = _Parser(_tokens(text), variables)
    statements = []
    while parser.next.kind != "end":
        where = f"line {parser.next.line}"
        try:
            statements.append(Statement(where, parser.constraint()))
        except RecursionError:
            raise ValueError(f"{where}: nested too deeply") from None
    return statements


def _tokens(text: str) -> list[Token]:
    tokens, place, line = [], 0, 1
    while place < len(text):
        if text[place].isspace():
            line += text[place] == "\n"
            place += 1
        elif match := TOKEN.match(text, place):
            kind, shown = str(match.lastgroup), match[0]
            if kind in ("name", "text"):
                shown = re.sub(r"\\(.)", r"\1", shown[1:-1])
            tokens.append(Token(kind, shown.upper() if kind == "word" else shown, line))
            line, place = line + match[0].count("\n"), match.end()
        else:
            raise ValueError(
                f"line {line}: expected a constraint, got "
                f"{text[place : place + 20].splitlines()[0]!r}"
            )
    return [*tokens, Token("end", "the end", line)]


def is_numeric(values: Sequence[str]) -> bool:
    """Whether PICT takes a parameter with these values for a number."""
    return all(NUMBER.fullmatch(value) for value in values)


def comparable(values: Sequence[str]) -> list[Any]:
    """The values as PICT compares them: numbers if all are, else texts in capitals."""
    return [float(value) if is_numeric(values) else value.upper() for value in values]


class _Parser:
    def __init__(self, tokens: list[Token], variables: Sequence[Variable]) -> None:
        self._tokens, self._variables = iter(tokens), variables
        self._index = {variable.name.upper(): index for index, variable in enumerate(variables)}
        self.next = next(self._tokens)

    def constraint(self) -> Expression:
        if not self._word("IF"):
            constraint = self._some()
        else:
            condition = self._some()
            if not self._word("THEN"):
                raise self._wrong("THEN")
            constraint = Some((Not(condition), self._some()))
            if self._word("ELSE"):
                constraint = Every((constraint, Some((condition, self._some()))))
        self._sign(";")
        return constraint

    def _some(self) -> Expression:
        return self._joined("OR", Some, lambda: self._joined("AND", Every, self._negated))

    def _joined(
        self, word: str, join: type[Some] | type[Every], part: Callable[[], Expression]
    ) -> Expression:
        """One part, or several with a word between them."""
        parts = [part()]
        while self._word(word):
            parts.append(part())
        return parts[0] if len(parts) == 1 else join(tuple(parts))

    def _negated(self) -> Expression:
        if self._word("NOT"):
            return Not(self._negated())
        if self.next.text == "(" and self.next.kind == "sign":
            self._take()
            inside = self._some()
            self._sign(")")
            return inside
        return self._term()

    def _term(self) -> Expression:
        if self.next.kind == "word" and self.next.text in ("ISNEGATIVE", "ISPOSITIVE"):
            raise ValueError(
                f"line {self.next.line}: {self.next.text} asks for negative values, which a space "
                "does not have"
            )
        variable = self._variable()
        negative = self._word("NOT")
        if self._word("IN"):
            self._sign("{")
            values = [self._value(variable)]
            while self.next.text == ",":
                self._take()
                values.append(self._value(variable))
            self._sign("}")
            term = self._compared(variable, lambda value, several: value in several, values)
        elif self._word("LIKE"):
            term = self._like(variable)
        elif negative or self.next.text not in RELATIONS:
            raise self._wrong("IN or LIKE" if negative else "one of =, <>, <, <=, >, >=, IN, LIKE")
        else:
            relation = RELATIONS[self._take().text]
            if self.next.kind == "name":
                return self._pair(variable, relation)
            term = self._compared(variable, relation, self._value(variable))
        return Not(term) if negative else term

    def _pair(self, first: int, relation: Callable[[Any, Any], Any]) -> Expression:
        line = self.next.line
        second = self._variable()
        these, those = (comparable(self._variables[v].values) for v in (first, second))
        if type(these[0]) is not type(those[0]):
            names = f"[{self._variables[first].name}] and [{self._variables[second].name}]"
            raise ValueError(
                f"line {line}: {names} cannot be compared: the values of one are numbers, of the "
                "other texts"
            )
        if first == second:
            return rows_where((first,), (len(these),), lambda c: relation(these[c], these[c]))
        return rows_where(
            (first, second), (len(these), len(those)), lambda c, d: relation(these[c], those[d])
        )

    def _compared(
        self, variable: int, relation: Callable[[Any, Any], Any], value: Any
    ) -> Expression:
        domain = comparable(self._variables[variable].values)
        return rows_where((variable,), (len(domain),), lambda c: relation(domain[c], value))

    def _like(self, variable: int) -> Expression:
        values = self._variables[variable].values
        if self.next.kind != "text" or is_numeric(values):
            texts = "LIKE to compare texts, not numbers"
            raise self._wrong(texts if is_numeric(values) else 'a pattern such as "FAT*"')
        parts = {"*": ".*", "?": "."}
        pattern = re.compile(
            "".join(parts.get(sign, re.escape(sign)) for sign in self._take().text.upper()),
            re.DOTALL,
        )
        return rows_where(
            (variable,), (len(values),), lambda c: pattern.fullmatch(values[c].upper())
        )

    def _value(self, variable: int) -> Any:
        compared = self._variables[variable]
        numeric = is_numeric(compared.values)
        if self.next.kind != ("number" if numeric else "text"):
            kind = "number" if numeric else "text in double quotes"
            raise self._wrong(f"a {kind} to compare [{compared.name}] with")
        text = self._take().text
        return float(text) if numeric else text.upper()

    def _variable(self) -> int:
        if self.next.kind != "name":
            raise self._wrong("a parameter such as [Size]")
        token = self._take()
        if token.text.upper() not in self._index:
            names = [variable.name for variable in self._variables]
            raise ValueError(
                f"line {token.line}: there is no parameter "
                f"[{token.text}]{nearest(token.text, names)}"
            )
        return self._index[token.text.upper()]

    def _word(self, word: str) -> bool:
        if self.next.kind == "word" and self.next.text == word:
            self._take()
            return True
        return False

    def _sign(self, sign: str) -> None:
        if self.next.kind != "sign" or self.next.text != sign:
            raise self._wrong(f"'{sign}'")
        self._take()

    def _take(self) -> Token:
        taken = self.next
        self.next = next(self._tokens, taken)
        return taken

    def _wrong(self, expected: str) -> ValueError:
        return ValueError(f"line {self.next.line}: expected {expected}, got {self.next.text}")
