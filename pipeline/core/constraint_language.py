"""Constraints as people write them, such as `if fog >= 50 then lights in {on, low}`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.core.comparisons import SIGNS, compare_variables, compare_with_number, number
from pipeline.core.constraints import Clause, not_among
from pipeline.core.expressions import Every, Expression, Not, OneOf, Some, clauses_of
from pipeline.core.variable import Variable
from pipeline.errors import shown

TOKEN = re.compile(
    r"""(?P<quoted>'(?:[^']|'')*'|"(?:[^"]|"")*")
    |(?P<sign>=>|<=|>=|!=|[=<>(){},])
    |(?P<word>[^\s'"=<>!(){},]+)""",
    re.VERBOSE,
)
KEYWORDS = frozenset(("if", "then", "else", "and", "or", "not", "in"))
DEEPEST = 50
"""Most levels of parentheses and conditions inside each other."""


@dataclass(frozen=True)
class _Token:
    """A word, sign or quoted name of a text.

    kind: quoted, sign, word, keyword or end. text: without quotes; a keyword in small letters.
    place: of its first character, from 0.
    """

    kind: str
    text: str
    place: int

    @property
    def shown(self) -> str:
        return "the end" if self.kind == "end" else repr(self.text)


class _WrongError(ValueError):
    """A mistake in a text: its place and the problem."""


def read_constraint(text: str, variables: Sequence[Variable]) -> tuple[Clause, ...]:
    """The clauses that hold together exactly where a constraint holds.

    Args:
        text: of the constraint.
        variables: of the space.

    Returns:
        Clauses over the indices of variables and categories; none if the text always holds.

    Raises:
        ValueError: wrong grammar, an unknown name, a comparison that the categories do not decide,
            too many clauses, or a text that never holds. The message names the place and what was
            expected there.

    >>> lamp = Variable("lamp", "categorical", values=("on", "off"))
    >>> fog = Variable("fog", "continuous", "%", 0, 100, cuts=(50,))
    >>> read_constraint("if fog >= 50 then lamp = on", (lamp, fog))[0][0]
    Literal(variable=0, category=1, equal=False)
    """
    try:
        expression = _Parser(text, variables).whole()
    except _WrongError as error:
        place, problem = error.args
        raise ValueError(f"constraint {shown(text)}, character {place + 1}: {problem}") from error
    try:
        return clauses_of(expression, [variable.size for variable in variables])
    except ValueError as error:
        raise ValueError(f"constraint {shown(text)}: {error}") from error


def _tokens(text: str) -> list[_Token]:
    tokens, place = [], 0
    while place < len(text):
        sign = text[place]
        if sign.isspace():
            place += 1
            continue
        if (match := TOKEN.match(text, place)) is None:
            if sign in "'\"":
                raise _WrongError(place, "this quote does not end")
            raise _WrongError(place, f"expected a name, a number or a sign, got {sign!r}")
        kind, token = str(match.lastgroup), match[0]
        if kind == "quoted":
            token = token[1:-1].replace(sign * 2, sign)
        elif kind == "word" and token.lower() in KEYWORDS:
            kind, token = "keyword", token.lower()
        tokens.append(_Token(kind, token, place))
        place = match.end()
    return [*tokens, _Token("end", "", len(text))]


class _Parser:
    """Reads a constraint by recursive descent.

    expression: if expression then expression [else expression] | some [=> expression];
    some: every {or every}; every: part {and part};
    part: {not} ( expression ) | {not} comparison.
    """

    def __init__(self, text: str, variables: Sequence[Variable]) -> None:
        self._tokens, self._variables, self._depth = iter(_tokens(text)), variables, 0
        self._index = {variable.name: index for index, variable in enumerate(variables)}
        self._next = next(self._tokens)

    def whole(self) -> Expression:
        expression = self._expression()
        if self._next.kind != "end":
            raise self._expected("and, or, => or the end")
        return expression

    def _expression(self) -> Expression:
        self._depth += 1
        if self._depth > DEEPEST:
            raise _WrongError(self._next.place, f"nested deeper than {DEEPEST} levels")
        expression: Expression
        if self._takes("keyword", "if"):
            condition = self._expression()
            self._take("keyword", "then", "and, or, => or then")
            expression = Some((Not(condition), self._expression()))
            if self._takes("keyword", "else"):
                expression = Every((expression, Some((condition, self._expression()))))
        else:
            expression = self._several("or", Some, lambda: self._several("and", Every, self._part))
            if self._takes("sign", "=>"):
                expression = Some((Not(expression), self._expression()))
        self._depth -= 1
        return expression

    def _several(
        self, word: str, join: type[Some] | type[Every], part: Callable[[], Expression]
    ) -> Expression:
        parts = [part()]
        while self._takes("keyword", word):
            parts.append(part())
        return parts[0] if len(parts) == 1 else join(tuple(parts))

    def _part(self) -> Expression:
        positive = True
        while self._takes("keyword", "not"):
            positive = not positive
        if self._takes("sign", "("):
            expression = self._expression()
            self._take("sign", ")", "and, or, => or ')'")
        else:
            expression = self._comparison()
        return expression if positive else Not(expression)

    def _comparison(self) -> Expression:
        name = self._name("a variable, not or '('")
        if name.text not in self._index:
            raise _WrongError(name.place, not_among("variable", list(self._index), name.text))
        variable, token = self._index[name.text], self._next
        if self._takes("keyword", "not"):
            self._take("keyword", "in", "in")
            return Not(self._listed(variable))
        if self._takes("keyword", "in"):
            return self._listed(variable)
        if token.kind != "sign" or token.text not in SIGNS:
            raise self._expected(f"{', '.join(SIGNS)}, in or not in")
        self._move()
        operand = self._name("a category, a number or a variable")
        try:
            return self._compared(variable, token.text, operand.text)
        except ValueError as error:
            raise _WrongError(operand.place, str(error)) from error

    def _compared(self, index: int, sign: str, operand: str) -> Expression:
        variable, other, constant = (
            self._variables[index],
            self._index.get(operand),
            number(operand),
        )
        of_category = sign in ("=", "!=") and operand in variable.labels
        if other is not None and (of_category or constant is not None):
            kind = f"a category of {variable.name}" if of_category else "a number"
            raise ValueError(
                f"{operand!r} is {kind} and a variable; "
                "for the category write in {…}, for the variable begin with it"
            )
        if other is not None:
            return compare_variables(self._variables, index, sign, other)
        if of_category:
            same = OneOf((index,), frozenset({(variable.labels.index(operand),)}))
            return same if sign == "=" else Not(same)
        if sign in ("=", "!="):
            raise ValueError(not_among("category", variable.labels, operand))
        if constant is None:
            raise ValueError(f"expected a number or a variable after {sign}, got {operand!r}")
        return compare_with_number(self._variables, index, sign, constant)

    def _listed(self, variable: int) -> OneOf:
        """`{a, b}`: one of these categories."""
        self._take("sign", "{", "'{'")
        rows, labels = set(), self._variables[variable].labels
        while True:
            name = self._name("a category")
            if name.text not in labels:
                raise _WrongError(name.place, not_among("category", labels, name.text))
            rows.add((labels.index(name.text),))
            if not self._takes("sign", ","):
                self._take("sign", "}", "',' or '}'")
                return OneOf((variable,), frozenset(rows))

    def _name(self, expected: str) -> _Token:
        if self._next.kind not in ("word", "quoted"):
            hint = "; put a name like this in quotes" if self._next.kind == "keyword" else ""
            raise _WrongError(
                self._next.place, f"expected {expected}, got {self._next.shown}{hint}"
            )
        return self._move()

    def _takes(self, kind: str, text: str) -> bool:
        """Move on if the next token is this one."""
        if (self._next.kind, self._next.text) != (kind, text):
            return False
        self._move()
        return True

    def _take(self, kind: str, text: str, expected: str) -> None:
        if not self._takes(kind, text):
            raise self._expected(expected)

    def _move(self) -> _Token:
        taken = self._next
        self._next = next(self._tokens, taken)
        return taken

    def _expected(self, expected: str) -> _WrongError:
        return _WrongError(self._next.place, f"expected {expected}, got {self._next.shown}")
