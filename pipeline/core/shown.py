"""How many of a scenario's combinations of categories some tests have covered."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from pipeline.core.space import Floats, Ints


def shown_share(sizes: tuple[int, ...], seen: Ints, asked: Ints, k: int) -> Floats:
    """For each asked point, the share of its combinations of k categories that a seen point has, too, as (n,) in [0, 1].

    sizes: number of categories of each of d variables. seen, asked: (m, d) and (n, d) category indices. k: 1 to d. With points drawn
    from a distribution, the mean is the probability that k categories of a random point, drawn with equal chances, have been seen
    together: k-projection coverage (Cheng et al., Definition 4) weighted by how often each cell occurs.
    """
    subsets = list(combinations(range(len(sizes)), k))
    total = np.zeros(len(asked))
    for subset in subsets:
        columns, shape = list(subset), [sizes[j] for j in subset]
        known = np.zeros(int(np.prod(shape)), bool)
        known[np.ravel_multi_index(tuple(seen[:, columns].T), shape)] = True
        total += known[np.ravel_multi_index(tuple(asked[:, columns].T), shape)]
    return np.asarray(total / len(subsets))
