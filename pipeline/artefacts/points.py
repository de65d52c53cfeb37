"""Tests as points of their scenario space."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.core.space import Floats, Space, Value
from pipeline.errors import InputError


def encode_tests(tests: pd.DataFrame, space: Space) -> Floats:
    """Points (n, d) of the rows of tests.parquet.

    Raises:
        InputError: naming a test outside the space or one that breaks a constraint.
    """
    points = np.empty((len(tests), len(space)))
    for column, variable in enumerate(space.variables):
        if variable.name not in tests:
            raise InputError(
                f"tests have no column '{variable.name}', which the scenario space has; make the "
                "campaign again"
            )
        for row, value in enumerate(tests[variable.name]):
            try:
                points[row, column] = variable.encode(value)
            except ValueError as error:
                raise InputError(
                    f"test {tests['test_id'].iloc[row]}: {error}; make the campaign again"
                ) from error
    if broken := space.violation(points):
        raise InputError(
            f"test {tests['test_id'].iloc[broken[0]]} {broken[1]}; make the campaign again"
        )
    return points


def concrete(test: pd.Series, space: Space) -> dict[str, Value]:
    """The concrete scenario of one row of tests.parquet: variable -> value in its unit."""
    values: dict[str, Value] = {}
    for variable in space.variables:
        value = test[variable.name]
        values[variable.name] = str(value) if variable.kind == "categorical" else float(value)
    return values
