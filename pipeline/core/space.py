"""A space S = S1 x ... x Sn of variables with constraints, and its encoding as arrays.

Source: thesis Def. 4.2; Cheng et al., Def. 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import getitem
from typing import Any

import numpy as np

from pipeline.core.constraint_language import read_constraint
from pipeline.core.constraints import Bools, Clause, Constraints, contradiction, parse_literal
from pipeline.core.coverage.mixed import NOTHING, Extras
from pipeline.core.rejection import feasible
from pipeline.core.variable import Floats, Ints, Kind, Value, Variable

__all__ = ["Floats", "Ints", "Kind", "Space", "Value", "Variable", "Written"]
Written = str | tuple[str, ...]
"""A constraint: a text of the constraint language, or a clause.

A clause lists literals, `variable = category` or `variable != category`; at least one must hold.
"""


@dataclass(frozen=True)
class Space:
    """Variables, and constraints that every point must satisfy.

    Points are (n, d) float64 arrays, columns in the order of `variables`.

    Args:
        variables: with distinct names.
        clauses: the constraints as they are written.
        extras: what coverage wants in addition to every combination of any k variables.

    Raises:
        ValueError: a duplicate name, a wrong constraint, constraints that contradict each other,
            or a wanted combination that breaks them.

    >>> fog = Variable("fog", "continuous", "%", low=0, high=100, step=50)
    >>> lamp = Variable("lamp", "categorical", values=("on", "off"))
    >>> space = Space((fog, lamp), ("if fog >= 50 then lamp = on",))
    >>> space.encode({"fog": 20, "lamp": "off"}).tolist()
    [20.0, 1.0]
    >>> space.decode(space.sample(1, np.random.default_rng(0))[0])["lamp"]
    'on'
    >>> space.violation(np.array([[20, 1], [80, 1]]))
    (1, "breaks the constraint 'if fog >= 50 then lamp = on': fog = 80, lamp = off")
    """

    variables: tuple[Variable, ...]
    clauses: tuple[Written, ...] = ()
    extras: Extras = NOTHING

    def __post_init__(self) -> None:
        if not self.variables or len(set(self.names)) != len(self.names):
            raise ValueError(f"a space needs variables with distinct names, got {self.names}")
        if self.clauses and not self.constraints.satisfiable({}):
            core = []
            for index in contradiction(self.sizes, self._compiled):
                written = self.clauses[index]
                core.append(written if isinstance(written, str) else f"[{', '.join(written)}]")
            raise ValueError(
                f"constraints: these contradict each other, so no point is left: {'; '.join(core)}"
            )
        for wanted in self.extras.combinations:
            fixed = dict(zip(wanted.variables, wanted.categories, strict=True))
            if not self.constraints.satisfiable(fixed):
                cell = self.cell(wanted.variables, wanted.categories)
                raise ValueError(f"combinations: the constraints leave no point with {cell}")

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
        clauses = tuple(clause for clauses in self._compiled for clause in clauses)
        return Constraints(self.sizes, clauses)

    @cached_property
    def _compiled(self) -> tuple[tuple[Clause, ...], ...]:
        """The clauses of each constraint."""
        labels = {variable.name: variable.labels for variable in self.variables}
        compiled: list[tuple[Clause, ...]] = []
        for written in self.clauses:
            if isinstance(written, str):
                compiled.append(read_constraint(written, self.variables))
            else:
                compiled.append((tuple(parse_literal(text, labels) for text in written),))
        return tuple(compiled)

    def __len__(self) -> int:
        return len(self.variables)

    def sample(self, count: int, rng: np.random.Generator) -> Floats:
        """Independent, uniform feasible points (thesis Table 6.1, row 1).

        Args:
            count: number of points.
            rng: source of randomness.

        Returns:
            (count, d) points.

        Raises:
            InputError: the constraints leave hardly any point.
        """

        def draw(size: int) -> Floats:
            return self.scale(rng.random((size, len(self))))

        def holds(points: Floats) -> Bools:
            return self.constraints.holds(self.categorise(points))

        return feasible(draw, holds, count, "the whole space") if self.clauses else draw(count)

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
        """A combination of categories in words, as `fog = 50, lamp = on`; both by index."""
        return ", ".join(
            f"{self.names[v]} = {self.variables[v].labels[c]}"
            for v, c in zip(variables, categories, strict=True)
        )

    def clause(self, index: int) -> str:
        """The constraint that a clause belongs to, in words."""
        ends = np.cumsum([len(clauses) for clauses in self._compiled])
        written = self.clauses[int(np.searchsorted(ends, index, side="right"))]
        return written if isinstance(written, str) else " or ".join(written)

    def violation(self, points: Floats) -> tuple[int, str] | None:
        """The first point that breaks a constraint.

        Args:
            points: (n, d).

        Returns:
            The point's row, and a text that names the constraint and the point's values; None if
            no point breaks a constraint.
        """
        broken = self.constraints.first_broken(self.categorise(points)) if self.clauses else None
        if broken is None:
            return None
        row, index = broken
        concrete = self.decode(points[row])
        values = []
        for v in sorted({literal.variable for literal in self.constraints.clauses[index]}):
            value = concrete[self.names[v]]
            values.append(
                f"{self.names[v]} = {value if isinstance(value, str) else format(value, 'g')}"
            )
        return row, f"breaks the constraint '{self.clause(index)}': {', '.join(values)}"

    def encode(self, concrete: Mapping[str, Value]) -> Floats:
        """The point of a concrete scenario.

        Args:
            concrete: value of every variable, by name.

        Returns:
            (d,) point.

        Raises:
            ValueError: a missing, unknown or out-of-range variable, or a broken constraint.
        """
        if set(concrete) != set(self.names):
            missing, unknown = set(self.names) - set(concrete), set(concrete) - set(self.names)
            raise ValueError(
                f"variables must be {list(self.names)}; "
                f"missing {sorted(missing)}, unknown {sorted(unknown)}"
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
        labels = [variable.labels for variable in self.variables]
        return [
            dict(zip(self.names, map(getitem, labels, row), strict=True))
            for row in categories.tolist()
        ]

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """The variables as plain data, `name: {kind, ...}`, in order; `from_dict` reads it back."""
        return {v.name: v.to_dict() for v in self.variables}

    @staticmethod
    def from_dict(
        variables: Mapping[str, Mapping[str, Any]], clauses: Sequence[str | Sequence[str]] = ()
    ) -> Space:
        """A space of variables as `to_dict` writes them, with constraints.

        Raises:
            ValueError: as `Variable.from_dict` and `Space` do.
        """
        return Space(
            tuple(Variable.from_dict(name, body) for name, body in variables.items()),
            tuple(written if isinstance(written, str) else tuple(written) for written in clauses),
        )
