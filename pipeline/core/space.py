"""A space S = S1 x ... x Sn of variables with constraints (thesis Def. 4.2; Cheng et al., Def. 1) and its encoding as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.core.constraint_language import read_constraint
from pipeline.core.constraints import Clause, Constraints, contradiction, parse_literal
from pipeline.core.coverage.mixed import NOTHING, Extras
from pipeline.core.rejection import feasible
from pipeline.core.variable import Floats, Ints, Kind, Value, Variable

__all__ = ["Floats", "Ints", "Kind", "Space", "Value", "Variable", "Written"]
Written = str | tuple[str, ...]
"""A constraint: a text of the constraint language, or a clause, of which one literal `variable = category` or `variable != category`
must hold."""


@dataclass(frozen=True)
class Space:
    """Variables, and constraints that every point must satisfy. Points are (n, d) float64 arrays, columns in the order of `variables`.

    clauses: the constraints as they are written. extras: what coverage wants in addition to every combination of any k variables.

    Raises ValueError for a duplicate name, a wrong constraint, constraints that contradict each other, and a wanted combination that breaks
    them.
    """

    variables: tuple[Variable, ...]
    clauses: tuple[Written, ...] = ()
    extras: Extras = NOTHING

    def __post_init__(self) -> None:
        if not self.variables or len(set(self.names)) != len(self.names):
            raise ValueError(f"a space needs variables with distinct names, got {self.names}")
        if self.clauses and not self.constraints.satisfiable({}):
            core = [self.clauses[i] for i in contradiction(self.sizes, self._compiled)]
            listed = "; ".join(
                one if isinstance(one, str) else f"[{', '.join(one)}]" for one in core
            )
            raise ValueError(
                f"constraints: these contradict each other, so no point is left: {listed}"
            )
        for one in self.extras.combinations:
            if not self.constraints.satisfiable(
                dict(zip(one.variables, one.categories, strict=True))
            ):
                raise ValueError(
                    f"combinations: the constraints leave no point with {self.cell(one.variables, one.categories)}"
                )

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(variable.name for variable in self.variables)

    @property
    def units(self) -> dict[str, str]:
        """The unit of each variable, by name; empty for none."""
        return {variable.name: variable.unit for variable in self.variables}

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of categories of each variable."""
        return tuple(variable.size for variable in self.variables)

    @property
    def weights(self) -> list[tuple[int, ...]]:
        """Points that are wanted of each category of each variable."""
        return [variable.weights or (1,) * variable.size for variable in self.variables]

    @cached_property
    def constraints(self) -> Constraints:
        """The clauses of all constraints, by the indices of variables and categories."""
        return Constraints(
            self.sizes, tuple(clause for clauses in self._compiled for clause in clauses)
        )

    @cached_property
    def _compiled(self) -> tuple[tuple[Clause, ...], ...]:
        """The clauses of each constraint."""
        labels = {variable.name: variable.labels for variable in self.variables}
        return tuple(
            read_constraint(one, self.variables)
            if isinstance(one, str)
            else (tuple(parse_literal(text, labels) for text in one),)
            for one in self.clauses
        )

    def __len__(self) -> int:
        return len(self.variables)

    def sample(self, count: int, rng: np.random.Generator) -> Floats:
        """(count, d) feasible points, independent and uniform (thesis Table 6.1, row 1); InputError if the constraints leave hardly any."""

        def draw(size: int) -> Floats:
            return self.scale(rng.random((size, len(self))))

        if not self.clauses:
            return draw(count)
        return feasible(
            draw,
            lambda points: self.constraints.holds(self.categorise(points)),
            count,
            "the whole space",
        )

    def scale(self, unit: Floats) -> Floats:
        """Convert (n, d) numbers in [0, 1) to points."""
        return np.column_stack([v.scale(unit[:, j]) for j, v in enumerate(self.variables)])

    def categorise(self, points: Floats) -> Ints:
        """Convert (n, d) points to (n, d) category indices."""
        return np.column_stack([v.categorise(points[:, j]) for j, v in enumerate(self.variables)])

    def representatives(self, categories: Ints) -> Floats:
        """Convert (n, d) category indices to their representative points."""
        return np.column_stack([v.grid[categories[:, j]] for j, v in enumerate(self.variables)])

    def within(self, categories: Ints, rng: np.random.Generator) -> Floats:
        """Convert (n, d) category indices to points drawn inside those categories."""
        unit = rng.random(categories.shape)
        return np.column_stack(
            [v.within(categories[:, j], unit[:, j]) for j, v in enumerate(self.variables)]
        )

    def cell(self, variables: Sequence[int], categories: Sequence[int]) -> str:
        """A combination of categories in words."""
        return ", ".join(
            f"{self.names[v]} = {self.variables[v].labels[c]}"
            for v, c in zip(variables, categories, strict=True)
        )

    def clause(self, index: int) -> str:
        """The constraint that a clause belongs to, in words."""
        ends = np.cumsum([len(clauses) for clauses in self._compiled])
        one = self.clauses[int(np.searchsorted(ends, index, side="right"))]
        return one if isinstance(one, str) else " or ".join(one)

    def violation(self, points: Floats) -> tuple[int, str] | None:
        """Text that names the first of (n, d) points that breaks a clause, the clause and the point's values; None if no point breaks
        one."""
        broken = self.constraints.first_broken(self.categorise(points)) if self.clauses else None
        if broken is None:
            return None
        row, index = broken
        concrete, named = (
            self.decode(points[row]),
            {literal.variable for literal in self.constraints.clauses[index]},
        )
        values = ", ".join(
            f"{self.names[v]} = {_shown(concrete[self.names[v]])}" for v in sorted(named)
        )
        return row, f"breaks the constraint '{self.clause(index)}': {values}"

    def encode(self, concrete: Mapping[str, Value]) -> Floats:
        """Convert a concrete scenario to a (d,) point; ValueError for a missing, unknown or out-of-range variable and a broken
        constraint."""
        if set(concrete) != set(self.names):
            missing, unknown = set(self.names) - set(concrete), set(concrete) - set(self.names)
            raise ValueError(
                f"variables must be {list(self.names)}; missing {sorted(missing)}, unknown {sorted(unknown)}"
            )
        point = np.array([v.encode(concrete[v.name]) for v in self.variables])
        if broken := self.violation(point[None]):
            raise ValueError(f"the scenario {broken[1]}")
        return point

    def decode(self, point: Floats) -> dict[str, Value]:
        """Convert a (d,) point to a concrete scenario."""
        return {v.name: v.decode(point[j]) for j, v in enumerate(self.variables)}

    def names_of(self, categories: Ints) -> list[dict[str, str]]:
        """Convert (n, d) category indices to the names of the categories, by variable."""
        return [
            {v.name: v.labels[int(c)] for v, c in zip(self.variables, row, strict=True)}
            for row in categories
        ]

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """The variables as plain data, `name: {kind, unit, ...}`, in order; `from_dict` reads it back."""
        return {v.name: v.to_dict() for v in self.variables}

    @staticmethod
    def from_dict(
        variables: Mapping[str, Mapping[str, Any]], clauses: Sequence[str | Sequence[str]] = ()
    ) -> Space:
        """A space of variables as `to_dict` writes them, with constraints."""
        written = tuple(one if isinstance(one, str) else tuple(one) for one in clauses)
        return Space(
            tuple(Variable.from_dict(name, body) for name, body in variables.items()), written
        )


def _shown(value: Value) -> str:
    return value if isinstance(value, str) else f"{value:g}"
