"""Points of a space as the numeric inputs of a meta-model."""

from __future__ import annotations

import numpy as np

from pipeline.core.space import Floats, Space
from pipeline.core.variable import Variable


def features(space: Space, points: Floats, attributes: bool = True) -> Floats:
    """Convert (n, d) points to (n, f) inputs: standardised numbers, cyclic ones as sine and cosine, categories one-hot.

    attributes: add the known numbers of each category, standardised over the categories, so that a model can tell which are alike.
    """
    columns: list[Floats] = []
    for j, variable in enumerate(space.variables):
        column = points[:, j]
        if variable.kind == "categorical":
            columns.append((column[:, None] == np.arange(variable.size)[None]).astype(float))
            columns += _attributes(variable, column) if attributes else []
            continue
        unit = (column - variable.low) / (variable.high - variable.low)
        if variable.cyclic:
            columns.append(np.column_stack([np.sin(2 * np.pi * unit), np.cos(2 * np.pi * unit)]))
        else:
            columns.append(((unit - 0.5) * np.sqrt(12))[:, None])
    return np.column_stack(columns)


def _attributes(variable: Variable, column: Floats) -> list[Floats]:
    """Each attribute of (n,) categories, (n, 1)."""
    known = [np.array(numbers) for _, numbers in variable.attributes]
    return [
        ((numbers - numbers.mean()) / max(float(numbers.std()), 1e-9))[column.astype(int)][:, None]
        for numbers in known
    ]
