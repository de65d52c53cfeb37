"""Basics of all parts of a configuration: strict types, names, seeds and the largest number."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from pipeline.core.names import check_name

STRICT = ConfigDict(
    extra="forbid", frozen=True, strict=True, allow_inf_nan=False, use_attribute_docstrings=True
)
"""No unknown key, no text for a number, no true for 1, nothing infinite. Lists become tuples only
if the data are validated as JSON."""
MOST = 10_000_000
"""The largest number of anything that has no limit of its own."""
Name = Annotated[str, AfterValidator(check_name)]
SEEDS = 2**31
"""Number of seeds: every seed is below it."""
Seed = Annotated[int, Field(ge=0, lt=SEEDS)]


class Part(BaseModel):
    """A part of a scenario's description."""

    model_config = STRICT
