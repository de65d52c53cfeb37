"""Points of a space as the numeric inputs of a meta-model."""

from __future__ import annotations

import numpy as np

from pipeline.core.space import Floats, Space


def features(space: Space, points: Floats, attributes: bool = True) -> Floats:
    """Convert points to standardised numbers, cyclic ones as sine and cosine, categories one-hot.

    Args:
        space: of the points.
        points: (n, d).
        attributes: add the attributes of each category, standardised over the categories, so that
            a model can tell which are alike.

    Returns:
        (n, f) inputs.

    >>> from pipeline.core.space import Space, Variable
    >>> space = Space((Variable("lit", "categorical", values=("no", "yes")),))
    >>> features(space, np.array([[0.0], [1.0]])).tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """
    columns: list[Floats] = []
    for j, variable in enumerate(space.variables):
        column = points[:, j]
        if variable.kind == "categorical":
            columns.append((column[:, None] == np.arange(variable.size)[None]).astype(float))
            for _, attribute in variable.attributes if attributes else ():
                numbers = np.array(attribute)
                standard = (numbers - numbers.mean()) / max(float(numbers.std()), 1e-9)
                columns.append(standard[column.astype(int)][:, None])
            continue
        unit = (column - variable.low) / (variable.high - variable.low)
        if variable.cyclic:
            columns.append(np.column_stack([np.sin(2 * np.pi * unit), np.cos(2 * np.pi * unit)]))
        else:
            columns.append(((unit - 0.5) * np.sqrt(12))[:, None])
    return np.column_stack(columns)
