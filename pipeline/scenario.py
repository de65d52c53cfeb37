"""The schema of a functional scenario: a town, the ego, the pedestrian and the other road users (thesis section 4.2, layers 1 to 4)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

VehicleKind = Literal["hatchback", "saloon", "van", "bus"]
OnStreet = Annotated[float, Field(ge=-70, le=145)]
Aside = Annotated[float, Field(ge=-12, le=12)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Town(_Part):
    """The street: its style, its layout's seed, a bus bay on the nearside (from x to x, metres), hedges and trees on both sides."""

    style: Literal["urban", "suburban"] = "urban"
    seed: int = Field(ge=0)
    bus_bay: tuple[OnStreet, OnStreet] | None = None
    vegetation: bool = False

    @model_validator(mode="after")
    def _bay_runs_forward(self) -> Town:
        if self.bus_bay and self.bus_bay[0] >= self.bus_bay[1]:
            raise ValueError(f"bus_bay must run from a smaller to a larger x, got {self.bus_bay}")
        return self


class Ego(_Part):
    """The ego vehicle: constant speed in its lane until it brakes; `horizon_s` before it would reach the conflict point it starts."""

    speed_kmh: float = Field(gt=0, le=130)
    lane_y_m: Aside = -1.75
    horizon_s: float = Field(gt=0.5, le=10)


class Crossing(_Part):
    """The pedestrian's straight path through the conflict point (x = 0 in the ego's lane): heading, degrees, 90 = from the nearside."""

    heading_deg: float = Field(ge=-180, le=180)


class Actor(_Part):
    """Another road user: its pose at the start of the episode, and its constant speed along its heading."""

    kind: VehicleKind
    x_m: OnStreet
    y_m: Aside
    heading_deg: float = Field(default=0, ge=-180, le=180)
    speed_kmh: float = Field(default=0, ge=0, le=130)
    paint: int = Field(default=0, ge=0)


class FunctionalScenario(_Part):
    """One functional scenario with its logical scenario space."""

    label: str
    description: str
    town: Town
    ego: Ego
    pedestrian: Crossing
    actors: dict[str, Actor] = {}
    space: dict[str, dict[str, Any]]
