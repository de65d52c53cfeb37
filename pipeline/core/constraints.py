"""Which combinations of categories can occur: clauses over `variable = category` and `variable != category` (paper Def. 1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.core.space import Ints, Space

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Literal:
    """`variable = category` if `equal`, else `variable != category`; both by index."""

    variable: int
    category: int
    equal: bool = True


Clause = tuple[Literal, ...]


@dataclass(frozen=True)
class Constraints:
    """A conjunction of clauses over variables with `sizes` categories each; no clause, no constraint."""

    sizes: tuple[int, ...]
    clauses: tuple[Clause, ...] = ()

    def __post_init__(self) -> None:
        for clause in self.clauses:
            for literal in clause:
                if not 0 <= literal.variable < len(self.sizes):
                    raise ValueError(f"a constraint names variable {literal.variable}, there are {len(self.sizes)}")
                if not 0 <= literal.category < self.sizes[literal.variable]:
                    size = self.sizes[literal.variable]
                    raise ValueError(f"category of variable {literal.variable} must be in [0, {size}), got {literal.category}")

    @cached_property
    def named(self) -> frozenset[int]:
        """Variables that some clause names."""
        return frozenset(literal.variable for clause in self.clauses for literal in clause)

    def holds(self, categories: Ints) -> Bools:
        """Whether each row of (n, d) category indices satisfies every clause, as (n,)."""
        result = np.ones(len(categories), dtype=bool)
        for clause in self.clauses:
            satisfied = np.zeros(len(categories), dtype=bool)
            for literal in clause:
                satisfied |= (categories[:, literal.variable] == literal.category) == literal.equal
            result &= satisfied
        return result

    def satisfiable(self, fixed: Mapping[int, int]) -> bool:
        """Whether some feasible point has the category `fixed[variable]` for each variable in `fixed`."""
        return self.complete(fixed) is not None

    def complete(self, fixed: Mapping[int, int]) -> tuple[int, ...] | None:
        """A feasible row of d category indices that agrees with `fixed`, None if there is none; lowest indices first."""
        domains = [np.ones(size, dtype=bool) for size in self.sizes]
        for variable, category in fixed.items():
            domains[variable] = np.arange(self.sizes[variable]) == category
        solution = _solve(domains, self.clauses)
        return None if solution is None else tuple(int(np.argmax(domain)) for domain in solution)

    def feasible_cells(self, variables: Sequence[int]) -> Bools:
        """Whether each cell of the given variables is reached by a feasible point; shape = the sizes of those variables.

        Variables that no clause names reach all their categories wherever the others have a solution, so they are not solved for.
        """
        cells = np.ones(tuple(self.sizes[v] for v in variables), dtype=bool)
        touched = [position for position, variable in enumerate(variables) if variable in self.named]
        for index in np.ndindex(*(cells.shape[position] for position in touched)):
            fixed = {variables[position]: category for position, category in zip(touched, index, strict=True)}
            if not self.satisfiable(fixed):
                where: list[int | slice] = [slice(None)] * len(variables)
                for position, category in zip(touched, index, strict=True):
                    where[position] = category
                cells[tuple(where)] = False
        return cells


def parse_constraints(space: Space, clauses: Sequence[Sequence[str]]) -> Constraints:
    """Constraints from text: each clause a list of `name = category` or `name != category`, of which one must hold.

    Raises ValueError that names the literal, what was expected and what came.
    """
    return Constraints(space.sizes, tuple(tuple(_literal(space, text) for text in clause) for clause in clauses))


def _literal(space: Space, text: str) -> Literal:
    equal = "!=" not in text
    name, sign, category = (part.strip() for part in text.partition("=" if equal else "!="))
    if not sign:
        raise ValueError(f"a constraint must read 'variable = category' or 'variable != category', got {text!r}")
    if name not in space.names:
        raise ValueError(f"constraint {text!r}: variable must be one of {', '.join(space.names)}; got {name!r}")
    variable = space.names.index(name)
    labels = space.variables[variable].labels
    if category not in labels:
        raise ValueError(f"constraint {text!r}: category must be one of {', '.join(labels)}; got {category!r}")
    return Literal(variable, labels.index(category), equal)


def _solve(domains: list[Bools], clauses: tuple[Clause, ...]) -> list[Bools] | None:
    """DPLL over domains: (size,) masks of the categories each variable may still take. Returns a solution's domains."""
    reduced = _propagate(domains, clauses)
    if reduced is None:
        return None
    open_clause = next((clause for clause in clauses if not any(_true(reduced, literal) for literal in clause)), None)
    if open_clause is None:
        return reduced
    literal = next(literal for literal in open_clause if not _false(reduced, literal))
    for keep in (literal, Literal(literal.variable, literal.category, not literal.equal)):
        solution = _solve(_impose(reduced, keep), clauses)
        if solution is not None:
            return solution
    return None


def _propagate(domains: list[Bools], clauses: tuple[Clause, ...]) -> list[Bools] | None:
    """Impose every literal that is the last one its clause can still satisfy; None on a conflict."""
    changed = True
    while changed:
        changed = False
        for clause in clauses:
            if any(_true(domains, literal) for literal in clause):
                continue
            possible = [literal for literal in clause if not _false(domains, literal)]
            if not possible:
                return None
            if len(possible) == 1:
                domains, changed = _impose(domains, possible[0]), True
    return domains


def _impose(domains: list[Bools], literal: Literal) -> list[Bools]:
    chosen = np.arange(len(domains[literal.variable])) == literal.category
    result = list(domains)
    result[literal.variable] = domains[literal.variable] & (chosen == literal.equal)
    return result


def _true(domains: list[Bools], literal: Literal) -> bool:
    """Whether the literal holds for every category left."""
    domain = domains[literal.variable]
    only = bool(domain[literal.category]) and int(domain.sum()) == 1
    return only if literal.equal else not domain[literal.category]


def _false(domains: list[Bools], literal: Literal) -> bool:
    return _true(domains, Literal(literal.variable, literal.category, not literal.equal))
