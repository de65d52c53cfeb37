"""Constraints on combinations of categories: clauses over `variable = category` and `variable != category` (paper Def. 1)."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pysat.solvers import Solver

from pipeline.core.variable import Ints

Bools = NDArray[np.bool_]
SOLVER = "minisat22"
"""The fastest of python-sat's solvers on many small problems."""
PAIRED = 200
"""Most named categories of a variable that exclude each other pair by pair."""


@dataclass(frozen=True)
class Literal:
    """`variable = category` if `equal`, else `variable != category`; both by index."""

    variable: int
    category: int
    equal: bool = True


Clause = tuple[Literal, ...]


@dataclass(frozen=True)
class Constraints:
    """A conjunction of clauses over variables with `sizes` categories each; without clauses there is no constraint."""

    sizes: tuple[int, ...]
    clauses: tuple[Clause, ...] = ()

    def __post_init__(self) -> None:
        for clause in self.clauses:
            for literal in clause:
                if not 0 <= literal.variable < len(self.sizes):
                    raise ValueError(
                        f"a constraint names variable {literal.variable}, there are {len(self.sizes)}"
                    )
                if not 0 <= literal.category < self.sizes[literal.variable]:
                    size = self.sizes[literal.variable]
                    raise ValueError(
                        f"category of variable {literal.variable} must be in [0, {size}), got {literal.category}"
                    )

    @cached_property
    def named(self) -> frozenset[int]:
        """Variables that at least one clause names."""
        return frozenset(literal.variable for clause in self.clauses for literal in clause)

    def holds(self, categories: Ints) -> Bools:
        """Whether each row of (n, d) category indices satisfies every clause, as (n,); an unknown category, -1, satisfies its literals."""
        result = np.ones(len(categories), dtype=bool)
        for clause in self.clauses:
            result &= satisfied(clause, categories)
        return result

    def first_broken(self, categories: Ints) -> tuple[int, int] | None:
        """The first of (n, d) rows that breaks a clause, and that clause's index; None if none does."""
        broken = np.flatnonzero(~self.holds(categories))
        if not len(broken):
            return None
        row = int(broken[0])
        return row, next(
            i
            for i, clause in enumerate(self.clauses)
            if not satisfied(clause, categories[row : row + 1])[0]
        )

    def satisfiable(self, fixed: Mapping[int, int]) -> bool:
        """Whether some feasible point has the category `fixed[variable]` for each variable in `fixed`."""
        return self.complete(fixed) is not None

    def complete(
        self, fixed: Mapping[int, int], rng: np.random.Generator | None = None
    ) -> tuple[int, ...] | None:
        """A feasible row of d category indices that agrees with `fixed`; None if there is none.

        With a generator the row is random: the generator makes the solver's free choices.
        """
        row = self._encoding.solve(fixed, rng)
        return None if row is None else tuple(row)

    def feasible_cells(self, variables: Sequence[int]) -> Bools:
        """Whether a feasible point reaches each cell of the given variables; shape = the sizes of those variables."""
        return self._encoding.cells(tuple(variables))

    def contradiction(self) -> tuple[int, ...]:
        """Indices of a minimal set of clauses that no point satisfies together; empty if a feasible point exists."""
        return (
            ()
            if self.satisfiable({})
            else contradiction(self.sizes, [(clause,) for clause in self.clauses])
        )

    @cached_property
    def _encoding(self) -> _Encoding:
        return _Encoding(self.sizes, self.clauses)

    def __getstate__(self) -> dict[str, Any]:
        return {"sizes": self.sizes, "clauses": self.clauses}  # A solver cannot be pickled.

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


def contradiction(
    sizes: tuple[int, ...], constraints: Sequence[Sequence[Clause]]
) -> tuple[int, ...]:
    """Indices of a minimal set of contradicting constraints, which no point satisfies together; each is a list of clauses."""
    # One solver for all subsets: each constraint holds if a variable of its own has category 1.
    clauses = tuple(
        (*clause, Literal(len(sizes) + i, 0))
        for i, several in enumerate(constraints)
        for clause in several
    )
    encoding = _Encoding((*sizes, *(2 for _ in constraints)), clauses)

    def core(of: Sequence[int]) -> set[int] | None:
        found = encoding.core({len(sizes) + i: 1 for i in of})
        return None if found is None else {variable - len(sizes) for variable in found}

    left = list(range(len(constraints)))
    needed = core(left) or set(left)
    for index in range(len(constraints)):
        if index in needed:
            found = core([i for i in left if i != index])
            if found is None:
                continue
            needed = found
        left.remove(index)
    return tuple(left)


def satisfied(clause: Clause, categories: Ints) -> Bools:
    """Whether each row of (n, d) category indices satisfies the clause, as (n,)."""
    result = np.zeros(len(categories), dtype=bool)
    for literal in clause:
        column = categories[:, literal.variable]
        result |= (
            (column == literal.category) | (column < 0)
            if literal.equal
            else column != literal.category
        )
    return result


class _Encoding:
    """The clauses in propositional logic: one proposition for each category that a clause names.

    All categories of a variable that no clause names are equivalent, so they share a class in which none of the variable's propositions
    holds. Every solution found is kept and marks all the cells that it reaches.
    """

    def __init__(self, sizes: tuple[int, ...], clauses: tuple[Clause, ...]) -> None:
        self._sizes = sizes
        self._categories: dict[int, list[int]] = {}
        for literal in (literal for clause in clauses for literal in clause):
            known = self._categories.setdefault(literal.variable, [])
            if literal.category not in known:
                known.append(literal.category)
        self._proposition: dict[tuple[int, int], int] = {}
        for variable, categories in sorted(self._categories.items()):
            for category in sorted(categories):
                self._proposition[variable, category] = len(self._proposition) + 1
        self._propositions = len(self._proposition)
        self._solver = Solver(name=SOLVER, bootstrap_with=self._formula(clauses))
        self._possible = bool(self._solver.solve())
        self._component = self._components(clauses)
        self._named = sorted(self._categories)
        self._column = {variable: column for column, variable in enumerate(self._named)}
        # Class of each category of each named variable: one per named category, the last one for all others.
        self._class = {v: self._classes(v) for v in self._named}
        self._unnamed = np.array([len(self._categories[v]) for v in self._named], dtype=np.int16)
        self._meaning = [(self._column[v], int(self._class[v][c])) for v, c in self._proposition]
        self._solutions, self._found = np.zeros((64, len(self._named)), dtype=np.int16), 0
        self._cells: dict[tuple[int, ...], Bools] = {}

    def _formula(self, clauses: tuple[Clause, ...]) -> list[list[int]]:
        formula = [
            [self._proposition[x.variable, x.category] * (1 if x.equal else -1) for x in clause]
            for clause in clauses
        ]
        for variable, categories in self._categories.items():
            own = [self._proposition[variable, category] for category in categories]
            formula += self._at_most_one(own)
            if len(own) == self._sizes[variable]:
                formula.append(own)
        return formula

    def _at_most_one(self, own: list[int]) -> list[list[int]]:
        """Pair by pair if that is short, else with a proposition for "one of them so far" after each (Sinz 2005)."""
        if len(own) <= PAIRED:
            return [[-first, -second] for first, second in combinations(own, 2)]
        so_far = range(self._propositions + 1, self._propositions + len(own) + 1)
        self._propositions += len(own)
        formula = [[-one, reached] for one, reached in zip(own, so_far, strict=True)]
        for before, reached, one in zip(so_far, so_far[1:], own[1:], strict=False):
            formula += [[-before, reached], [-before, -one]]
        return formula

    def _components(self, clauses: tuple[Clause, ...]) -> dict[int, int]:
        """Component of each named variable: variables of different components do not constrain each other."""
        component = {variable: variable for variable in self._categories}

        def root(variable: int) -> int:
            while component[variable] != variable:
                variable = component[variable]
            return variable

        for clause in clauses:
            for literal in clause[1:]:
                component[root(literal.variable)] = root(clause[0].variable)
        return {variable: root(variable) for variable in component}

    def _classes(self, variable: int) -> Ints:
        named = sorted(self._categories[variable])
        classes = np.full(self._sizes[variable], len(named), dtype=np.int64)
        classes[named] = np.arange(len(named))
        return classes

    def _assumptions(self, variable: int, category: int) -> list[int]:
        if (variable, category) in self._proposition:
            return [self._proposition[variable, category]]
        return [-self._proposition[variable, other] for other in self._categories.get(variable, ())]

    def solve(
        self, fixed: Mapping[int, int], rng: np.random.Generator | None = None
    ) -> list[int] | None:
        """A feasible row with the fixed categories; free variables get their first free category, or a random one."""
        assumptions = [
            literal
            for variable, category in fixed.items()
            for literal in self._assumptions(variable, category)
        ]
        if rng is not None and self._proposition:
            signs = rng.integers(2, size=len(self._proposition)) * 2 - 1
            self._solver.set_phases([int(sign) * (i + 1) for i, sign in enumerate(signs)])
        if not self._solver.solve(assumptions=assumptions):
            return None
        true = {literal for literal in self._solver.get_model() if literal > 0}
        row = []
        for variable, size in enumerate(self._sizes):
            if variable in fixed:
                row.append(fixed[variable])
                continue
            chosen = [
                c
                for c in self._categories.get(variable, ())
                if self._proposition[variable, c] in true
            ]
            free = chosen or [c for c in range(size) if (variable, c) not in self._proposition]
            row.append(free[0] if rng is None else free[int(rng.integers(len(free)))])
        return row

    def core(self, fixed: Mapping[int, int]) -> set[int] | None:
        """Variables whose fixed categories no feasible row has together; None if some row has all of them."""
        variable_of = {
            literal: variable
            for variable, category in fixed.items()
            for literal in self._assumptions(variable, category)
        }
        if self._solver.solve(assumptions=list(variable_of)):
            return None
        return {variable_of[literal] for literal in self._solver.get_core() or ()}

    def cells(self, variables: tuple[int, ...]) -> Bools:
        """Feasible cells of a plane: the product of the feasible cells of its parts in different components."""
        result = np.ones(tuple(self._sizes[v] for v in variables), dtype=bool)
        groups: dict[int, list[int]] = {}
        for axis, variable in enumerate(variables):
            if variable in self._component:
                groups.setdefault(self._component[variable], []).append(axis)
        for axes in groups.values():
            part = self._component_cells(tuple(variables[axis] for axis in axes))
            result &= part.reshape(
                [self._sizes[v] if axis in axes else 1 for axis, v in enumerate(variables)]
            )
        return result & self._possible

    def _component_cells(self, variables: tuple[int, ...]) -> Bools:
        if list(variables) != sorted(variables):
            order = sorted(range(len(variables)), key=lambda axis: variables[axis])
            return self._component_cells(tuple(variables[axis] for axis in order)).transpose(
                np.argsort(order)
            )
        if variables not in self._cells:
            self._cells[variables] = self._solved_cells(variables)
        return self._cells[variables]

    def _solved_cells(self, variables: tuple[int, ...]) -> Bools:
        counts = [int(self._class[v].max()) + 1 for v in variables]
        classes = np.zeros(counts, dtype=bool)
        columns = [self._column[v] for v in variables]
        classes[tuple(self._solutions[: self._found, columns].T)] = True
        for cell in product(*map(range, counts)):
            if classes[cell]:
                continue
            assumptions = []
            for variable, number in zip(variables, cell, strict=True):
                assumptions += self._assumptions(
                    variable, int(np.argmax(self._class[variable] == number))
                )
            if self._solver.solve(assumptions=assumptions):
                self._keep_solution()
                classes[tuple(self._solutions[self._found - 1, columns])] = True
        return classes[np.ix_(*(self._class[v] for v in variables))]

    def _keep_solution(self) -> None:
        row = self._unnamed.copy()
        for literal in self._solver.get_model():
            if 0 < literal <= len(self._meaning):
                column, number = self._meaning[literal - 1]
                row[column] = number
        if self._found == len(self._solutions):
            self._solutions = np.vstack([self._solutions, np.zeros_like(self._solutions)])
        self._solutions[self._found] = row
        self._found += 1


def parse_literal(text: str, labels: Mapping[str, Sequence[str]]) -> Literal:
    """One literal. labels: of the categories of each variable, in order."""
    equal = "!=" not in text
    name, sign, category = (part.strip() for part in text.partition("=" if equal else "!="))
    if not sign:
        raise ValueError(
            f"a constraint must read 'variable = category' or 'variable != category', got {text!r}"
        )
    if name not in labels:
        raise ValueError(f"constraint {text!r}: {no_variable(list(labels), name)}")
    if category not in labels[name]:
        raise ValueError(f"constraint {text!r}: {no_category(labels[name], category)}")
    return Literal(list(labels).index(name), list(labels[name]).index(category), equal)


def no_variable(names: Sequence[str], wrong: str) -> str:
    """What to say of a name that no variable has."""
    return f"variable must be one of {_some(names, wrong)}; got {wrong!r}{_meant(names, wrong)}"


def no_category(labels: Sequence[str], wrong: str) -> str:
    """What to say of a name that no category of a variable has."""
    return f"category must be one of {_some(labels, wrong)}; got {wrong!r}{_meant(labels, wrong)}"


def _meant(names: Sequence[str], wrong: str) -> str:
    close = _nearest(names, wrong, 1)
    return f"; did you mean '{close[0]}'?" if close else ""


def _some(names: Sequence[str], wrong: str) -> str:
    """The names, or, if there are many, those most like a wrong one."""
    return ", ".join(names if len(names) <= 12 else [*_nearest(names, wrong, 3, cutoff=0), "…"])


def _nearest(names: Sequence[str], wrong: str, count: int, cutoff: float = 0.5) -> list[str]:
    """The names most like a wrong one: by value if all are numbers, else by spelling."""
    try:
        return sorted(names, key=lambda name: abs(float(name) - float(wrong)))[:count]
    except ValueError:
        return difflib.get_close_matches(wrong, names, n=count, cutoff=cutoff)
