"""How many of a scenario's combinations of categories some tests have covered."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from pipeline.core.space import Floats, Ints


def shown_share(sizes: tuple[int, ...], seen: Ints, asked: Ints, k: int) -> Floats:
    """Share of the k-combinations of categories of each asked point that a seen point has, too.

    With points drawn from a distribution, the mean is the probability that k categories of a
    random point, drawn with equal chances, have been seen together: k-projection coverage (Cheng et
    al., Definition 4) weighted by how often each cell occurs.

    Args:
        sizes: (d,) number of categories of each variable.
        seen: (m, d) category indices.
        asked: (n, d) category indices.
        k: 1 to d.

    Returns:
        (n,) shares in [0, 1].

    >>> shown_share((2, 2), np.array([[0, 0]]), np.array([[0, 0], [0, 1], [1, 1]]), k=1).tolist()
    [1.0, 0.5, 0.0]
    """
    subsets = list(combinations(range(len(sizes)), k))
    total = np.zeros(len(asked))
    for subset in subsets:
        columns, shape = list(subset), [sizes[j] for j in subset]
        is_seen = np.zeros(int(np.prod(shape)), bool)
        is_seen[np.ravel_multi_index(tuple(seen[:, columns].T), shape)] = True
        total += is_seen[np.ravel_multi_index(tuple(asked[:, columns].T), shape)]
    return np.asarray(total / len(subsets))
