"""The front-car domain: snapshots under six operating conditions, and a detector of the car ahead.

Source: Cheng et al., section 5.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from pydantic import Field, field_validator, model_validator

from pipeline.core.space import Ints, Space, Variable, Written
from pipeline.scenarios.parts import MOST, Part, Seed

CONDITIONS: Mapping[str, tuple[str, ...]] = {
    "weather": ("sunny", "cloudy", "rainy"),
    "lane_orientation": ("straight", "curvy"),
    "lanes": ("1", "2"),
    "current_lane": ("1", "2"),
    "forward_vehicle": ("absent", "present"),
    "oncoming_vehicle": ("absent", "present"),
}
"""All values of the operating conditions. lanes: in the ego's direction. current_lane: counted from
the nearside kerb."""


class SnapshotSpace(Part):
    """The operating conditions of a study: values of each, and clauses."""

    variables: dict[str, tuple[str, ...]]
    """Values of each operating condition: one or more of those that can be rendered."""
    constraints: tuple[Written, ...]
    """Each is a text such as `current_lane <= lanes`, or a clause: one of its literals `name =
    value` or `name != value` must hold."""

    @field_validator("variables", mode="before")
    @classmethod
    def _as_text(cls, plain: object) -> object:
        """Accept whole numbers as names of values."""
        if not isinstance(plain, Mapping):
            return plain
        texts: dict[object, object] = {}
        for name, values in plain.items():
            texts[name] = values
            if isinstance(values, list | tuple):
                texts[name] = tuple(str(value) if type(value) is int else value for value in values)
        return texts

    @model_validator(mode="after")
    def _can_be_rendered(self) -> SnapshotSpace:
        if set(self.variables) != set(CONDITIONS):
            raise ValueError(
                f"variables must be {', '.join(CONDITIONS)}; got {', '.join(self.variables)}"
            )
        for name, values in self.variables.items():
            if unknown := set(values) - set(CONDITIONS[name]):
                raise ValueError(
                    f"variables.{name} must be among {', '.join(CONDITIONS[name])}; "
                    f"got {', '.join(sorted(unknown))}"
                )
        space = self.space()
        lanes, current = space.names.index("lanes"), space.names.index("current_lane")
        lane_values, current_values = self.variables["lanes"], self.variables["current_lane"]
        if "1" in lane_values and "2" in current_values:
            fixed = {lanes: lane_values.index("1"), current: current_values.index("2")}
            if space.constraints.satisfiable(fixed):
                raise ValueError(
                    "constraints must exclude the second of one lane: "
                    "add [lanes = 2, current_lane != 2]"
                )
        return self

    def space(self) -> Space:
        """The space of the operating conditions.

        Raises:
            ValueError: a condition without values or with duplicates, a wrong literal, or
                contradictory constraints.
        """
        variables = [
            Variable(name, "categorical", values=values) for name, values in self.variables.items()
        ]
        return Space(tuple(variables), self.constraints)

    def feasible_points(self) -> Ints:
        """Category indices (m, d) of all points that the constraints allow, in their order."""
        space = self.space()
        every = np.indices(space.sizes).reshape(len(space), -1).T
        return np.asarray(every[space.constraints.holds(every)], np.int64)


class FrontCar(Part):
    """The front-car study: from a few random points to full coverage, and what a detector gains
    from it."""

    space: SnapshotSpace
    k: int = Field(ge=1, le=6)
    """k of the projection coverage that the proposals bring to 100 %."""
    existing: int = Field(ge=1, le=1000)
    """Number of random points at the start."""
    seed: Seed
    """Seed of points, towns and everything that the conditions leave open."""
    images: int = Field(ge=20, le=100_000)
    """Number of snapshots to train each detector, training and validation together, shared evenly
    among its points."""
    validation_share: float = Field(gt=0, lt=0.9)
    """Share of each point's snapshots used for validation."""
    test_images: int = Field(ge=1, le=1000)
    """Number of test snapshots of every feasible point, in separate towns."""
    batch_size: int = Field(ge=2, le=4096)
    """Frames per step."""
    iterations: int = Field(ge=1, le=MOST)
    """Number of training steps of each detector, from the shipped detector's weights."""
    learning_rate: float = Field(gt=0, lt=1)
    """Peak learning rate of the schedule."""

    def images_of(self, points: int) -> list[int]:
        """How many of `images` show each of several points, as equal as possible."""
        each, more = divmod(self.images, points)
        return [each + (i < more) for i in range(points)]
