"""Constraints on combinations of categories (Cheng et al., Def. 1).

A constraint is a list of clauses over `variable = category` and `variable != category`.
"""

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
    """A conjunction of clauses over variables; without clauses, every point is feasible.

    Args:
        sizes: (d,) number of categories of each variable.
        clauses: over the indices of variables and categories.

    Raises:
        ValueError: a clause names a variable or a category that does not exist.

    >>> limits = Constraints((2, 3), ((Literal(0, 0), Literal(1, 2)),))
    >>> limits.holds(np.array([[0, 1], [1, 1], [1, 2]])).tolist()
    [True, False, True]
    >>> limits.complete({0: 1})
    (1, 2)
    >>> limits.feasible_cells((0, 1)).tolist()
    [[True, True, True], [False, False, True]]
    """

    sizes: tuple[int, ...]
    clauses: tuple[Clause, ...] = ()

    def __post_init__(self) -> None:
        for clause in self.clauses:
            for literal in clause:
                variable, category = literal.variable, literal.category
                if not 0 <= variable < len(self.sizes):
                    raise ValueError(
                        f"a constraint names variable {variable}, there are {len(self.sizes)}"
                    )
                if not 0 <= category < self.sizes[variable]:
                    raise ValueError(
                        f"category of variable {variable} must be in [0, {self.sizes[variable]}), "
                        f"got {category}"
                    )

    @cached_property
    def named(self) -> frozenset[int]:
        """Variables that at least one clause names."""
        return frozenset(literal.variable for clause in self.clauses for literal in clause)

    def holds(self, categories: Ints) -> Bools:
        """Whether each row satisfies every clause.

        Args:
            categories: (n, d) category indices; an unknown one, -1, satisfies its literals.

        Returns:
            (n,) bool.
        """
        result = np.ones(len(categories), dtype=bool)
        for clause in self.clauses:
            result &= satisfied(clause, categories)
        return result

    def first_broken(self, categories: Ints) -> tuple[int, int] | None:
        """The first of (n, d) rows that breaks a clause, and that clause's index; else None."""
        broken = np.flatnonzero(~self.holds(categories))
        if not len(broken):
            return None
        row = int(broken[0])
        kept = [bool(satisfied(clause, categories[[row]])) for clause in self.clauses]
        return row, kept.index(False)

    def satisfiable(self, fixed: Mapping[int, int]) -> bool:
        """Whether some feasible point has the categories `fixed`, by variable."""
        return self.complete(fixed) is not None

    def complete(
        self, fixed: Mapping[int, int], rng: np.random.Generator | None = None
    ) -> tuple[int, ...] | None:
        """A feasible row that has the fixed categories.

        Args:
            fixed: category of some variables, both by index.
            rng: makes the solver's free choices; without it, the row is always the same.

        Returns:
            d category indices; None if no feasible row has the fixed categories.
        """
        row = self._encoding.solve(fixed, rng)
        return None if row is None else tuple(row)

    def feasible_cells(self, variables: Sequence[int]) -> Bools:
        """Whether a feasible point reaches each cell of some variables; shape = their sizes."""
        return self._encoding.cells(tuple(variables))

    def contradiction(self) -> tuple[int, ...]:
        """Indices of a minimal set of contradicting clauses; empty if a feasible point exists."""
        if self.satisfiable({}):
            return ()
        return contradiction(self.sizes, [(clause,) for clause in self.clauses])

    @cached_property
    def _encoding(self) -> _Encoding:
        return _Encoding(self.sizes, self.clauses)

    def __getstate__(self) -> dict[str, Any]:
        return {"sizes": self.sizes, "clauses": self.clauses}  # A solver cannot be pickled.


def contradiction(
    sizes: tuple[int, ...], constraints: Sequence[Sequence[Clause]]
) -> tuple[int, ...]:
    """A minimal set of constraints that no point satisfies together.

    Args:
        sizes: (d,) number of categories of each variable.
        constraints: each is a list of clauses.

    Returns:
        Indices of the contradicting constraints, ascending.
    """
    # A switch, one more variable, for each constraint: the constraint holds if it has category 1.
    # So all subsets of constraints share a solver.
    clauses: list[Clause] = []
    for i, constraint in enumerate(constraints):
        clauses += [(*clause, Literal(len(sizes) + i, 0)) for clause in constraint]
    encoding = _Encoding((*sizes, *(2 for _ in constraints)), tuple(clauses))

    def core(subset: Sequence[int]) -> set[int] | None:
        switches = encoding.core({len(sizes) + i: 1 for i in subset})
        return None if switches is None else {switch - len(sizes) for switch in switches}

    left = list(range(len(constraints)))
    needed = core(left) or set(left)
    for index in range(len(constraints)):
        if index in needed:
            smaller = core([i for i in left if i != index])
            if smaller is None:
                continue
            needed = smaller
        left.remove(index)
    return tuple(left)


def satisfied(clause: Clause, categories: Ints) -> Bools:
    """Whether each row of (n, d) category indices satisfies the clause, as (n,)."""
    result = np.zeros(len(categories), dtype=bool)
    for literal in clause:
        column = categories[:, literal.variable]
        if literal.equal:
            result |= (column == literal.category) | (column < 0)
        else:
            result |= column != literal.category
    return result


class _Encoding:
    """The clauses in propositional logic: a proposition for each category that a clause names.

    All categories of a variable that no clause names are equivalent, so they share a class in
    which none of the variable's propositions holds. Every solution is kept and marks all the
    cells that it reaches.
    """

    def __init__(self, sizes: tuple[int, ...], clauses: tuple[Clause, ...]) -> None:
        self._sizes = sizes
        self._categories: dict[int, list[int]] = {}
        for clause in clauses:
            for literal in clause:
                categories = self._categories.setdefault(literal.variable, [])
                if literal.category not in categories:
                    categories.append(literal.category)
        self._named = sorted(self._categories)
        self._proposition: dict[tuple[int, int], int] = {}
        for variable in self._named:
            for category in sorted(self._categories[variable]):
                self._proposition[variable, category] = len(self._proposition) + 1
        self._propositions = len(self._proposition)
        self._solver = Solver(name=SOLVER, bootstrap_with=self._formula(clauses))
        self._possible = bool(self._solver.solve())
        self._component = self._components(clauses)
        self._column = {variable: column for column, variable in enumerate(self._named)}
        # Class of each category of each named variable: one per named category, the last one for
        # all others.
        self._class: dict[int, Ints] = {}
        for variable in self._named:
            categories = sorted(self._categories[variable])
            classes = np.full(sizes[variable], len(categories), dtype=np.int64)
            classes[categories] = np.arange(len(categories))
            self._class[variable] = classes
        self._unnamed = np.array([len(self._categories[v]) for v in self._named], dtype=np.int16)
        self._meaning = [(self._column[v], int(self._class[v][c])) for v, c in self._proposition]
        self._solutions = np.zeros((64, len(self._named)), dtype=np.int16)
        self._solution_count = 0
        self._cells: dict[tuple[int, ...], Bools] = {}

    def _formula(self, clauses: tuple[Clause, ...]) -> list[list[int]]:
        formula = []
        for clause in clauses:
            signed = []
            for literal in clause:
                proposition = self._proposition[literal.variable, literal.category]
                signed.append(proposition if literal.equal else -proposition)
            formula.append(signed)
        for variable, categories in self._categories.items():
            propositions = [self._proposition[variable, category] for category in categories]
            formula += self._at_most_one(propositions)
            if len(propositions) == self._sizes[variable]:
                formula.append(propositions)
        return formula

    def _at_most_one(self, propositions: list[int]) -> list[list[int]]:
        """Pair by pair if that is short, else by further propositions (Sinz 2005).

        The further ones mean that a proposition up to this place holds.
        """
        if len(propositions) <= PAIRED:
            return [[-first, -second] for first, second in combinations(propositions, 2)]
        so_far = range(self._propositions + 1, self._propositions + len(propositions) + 1)
        self._propositions += len(propositions)
        formula = [[-here, reached] for here, reached in zip(propositions, so_far, strict=True)]
        for before, reached, here in zip(so_far, so_far[1:], propositions[1:], strict=False):
            formula += [[-before, reached], [-before, -here]]
        return formula

    def _components(self, clauses: tuple[Clause, ...]) -> dict[int, int]:
        """Component of each named variable; only variables of a component limit each other."""
        component = {variable: variable for variable in self._categories}

        def root(variable: int) -> int:
            while component[variable] != variable:
                variable = component[variable]
            return variable

        for clause in clauses:
            for literal in clause[1:]:
                component[root(literal.variable)] = root(clause[0].variable)
        return {variable: root(variable) for variable in component}

    def _assumptions(self, variable: int, category: int) -> list[int]:
        if (variable, category) in self._proposition:
            return [self._proposition[variable, category]]
        return [-self._proposition[variable, other] for other in self._categories.get(variable, ())]

    def solve(
        self, fixed: Mapping[int, int], rng: np.random.Generator | None = None
    ) -> list[int] | None:
        """A feasible row that has the fixed categories; without `rng`, the first free ones else."""
        assumptions: list[int] = []
        for variable, category in fixed.items():
            assumptions += self._assumptions(variable, category)
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
            free = []
            for category in self._categories.get(variable, ()):
                if self._proposition[variable, category] in true:
                    free.append(category)
            if not free:
                free = [c for c in range(size) if (variable, c) not in self._proposition]
            row.append(free[0] if rng is None else free[int(rng.integers(len(free)))])
        return row

    def core(self, fixed: Mapping[int, int]) -> set[int] | None:
        """Variables whose fixed categories contradict each other; None if a row has all of them."""
        variable_of: dict[int, int] = {}
        for variable, category in fixed.items():
            for assumption in self._assumptions(variable, category):
                variable_of[assumption] = variable
        if self._solver.solve(assumptions=list(variable_of)):
            return None
        return {variable_of[literal] for literal in self._solver.get_core() or ()}

    def cells(self, variables: tuple[int, ...]) -> Bools:
        """Feasible cells of a plane: the product of those of its parts in different components."""
        result = np.ones(tuple(self._sizes[v] for v in variables), dtype=bool)
        groups: dict[int, list[int]] = {}
        for axis, variable in enumerate(variables):
            if variable in self._component:
                groups.setdefault(self._component[variable], []).append(axis)
        for axes in groups.values():
            part = self._component_cells(tuple(variables[axis] for axis in axes))
            shape = [1] * len(variables)
            for axis in axes:
                shape[axis] = self._sizes[variables[axis]]
            result &= part.reshape(shape)
        return result & self._possible

    def _component_cells(self, variables: tuple[int, ...]) -> Bools:
        if list(variables) != sorted(variables):
            order = sorted(range(len(variables)), key=lambda axis: variables[axis])
            cells = self._component_cells(tuple(variables[axis] for axis in order))
            return cells.transpose(np.argsort(order))
        if variables not in self._cells:
            self._cells[variables] = self._solved_cells(variables)
        return self._cells[variables]

    def _solved_cells(self, variables: tuple[int, ...]) -> Bools:
        counts = [int(self._class[v].max()) + 1 for v in variables]
        classes = np.zeros(counts, dtype=bool)
        columns = [self._column[v] for v in variables]
        classes[tuple(self._solutions[: self._solution_count, columns].T)] = True
        for cell in product(*map(range, counts)):
            if classes[cell]:
                continue
            assumptions = []
            for variable, number in zip(variables, cell, strict=True):
                category = int(np.argmax(self._class[variable] == number))
                assumptions += self._assumptions(variable, category)
            if not self._solver.solve(assumptions=assumptions):
                continue
            solution = self._unnamed.copy()
            for literal in self._solver.get_model():
                if 0 < literal <= len(self._meaning):
                    column, number = self._meaning[literal - 1]
                    solution[column] = number
            classes[tuple(solution[columns])] = True
            if self._solution_count == len(self._solutions):
                self._solutions = np.vstack([self._solutions, np.zeros_like(self._solutions)])
            self._solutions[self._solution_count] = solution
            self._solution_count += 1
        return classes[np.ix_(*(self._class[v] for v in variables))]


def parse_literal(text: str, labels: Mapping[str, Sequence[str]]) -> Literal:
    """The literal of a text.

    Args:
        text: `variable = category` or `variable != category`.
        labels: names of each variable's categories, in order.

    Raises:
        ValueError: the text has another form, or names an unknown variable or category.

    >>> parse_literal("kind != b", {"kind": ("a", "b")})
    Literal(variable=0, category=1, equal=False)
    """
    equal = "!=" not in text
    name, sign, category = (part.strip() for part in text.partition("=" if equal else "!="))
    if not sign:
        raise ValueError(
            f"a constraint must read 'variable = category' or 'variable != category', got {text!r}"
        )
    if name not in labels:
        raise ValueError(f"constraint {text!r}: {not_among('variable', list(labels), name)}")
    if category not in labels[name]:
        raise ValueError(f"constraint {text!r}: {not_among('category', labels[name], category)}")
    return Literal(list(labels).index(name), list(labels[name]).index(category), equal)


def not_among(what: str, names: Sequence[str], wrong: str) -> str:
    """The message for an unknown name: the possible names, the nearest ones if they are many.

    >>> not_among("category", ("on", "off"), "of")
    "category must be one of on, off; got 'of'; did you mean 'off'?"
    """
    few = names if len(names) <= 12 else [*_nearest(names, wrong, 3, cutoff=0), "…"]
    close = _nearest(names, wrong, 1)
    hint = f"; did you mean '{close[0]}'?" if close else ""
    return f"{what} must be one of {', '.join(few)}; got {wrong!r}{hint}"


def _nearest(names: Sequence[str], wrong: str, count: int, cutoff: float = 0.5) -> list[str]:
    """The names most like a wrong one: by value if all are numbers, else by spelling."""
    try:
        return sorted(names, key=lambda name: abs(float(name) - float(wrong)))[:count]
    except ValueError:
        return difflib.get_close_matches(wrong, names, n=count, cutoff=cutoff)
