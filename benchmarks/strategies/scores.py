"""What one campaign found after each budget."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.cluster import DBSCAN

from pipeline.core.density import PROBES
from pipeline.core.distance import mixed_distance
from pipeline.core.measures import failure_sequence, kinds_of, pair_coverage, theta_area
from pipeline.core.space import Floats, Space

BUDGETS = (120, 300, 1000)
"""Numbers of tests after which campaigns are compared."""
MEASURES = ("failures", "kinds", "gamma_t", "gamma_f", "area", "regions")


def scores(
    space: Space,
    points: Floats,
    kpi: Floats,
    threshold_s: float,
    neighbours: float,
    min_failures: int,
) -> dict[str, Any]:
    """The measures of a campaign's tests in order, (n, d) and (n,): for each budget up to n `failures_120`, `kinds_120` and so on.

    failed_at: positions of the failures, from 1. errors: tests without a KPI; they used budget. neighbours, min_failures: see
    `regions` in the configuration.
    """
    failed, valid = kpi <= threshold_s, np.isfinite(kpi)  # NaN is not a failure.
    row: dict[str, Any] = {
        "errors": int((~valid).sum()),
        "failed_at": (np.flatnonzero(failed) + 1).tolist(),
    }
    for budget in (budget for budget in BUDGETS if budget <= len(kpi)):
        failures = points[:budget][failed[:budget]]
        found = {
            "failures": len(failures),
            "kinds": kinds_of(space, failures),
            "gamma_t": pair_coverage(space, points[:budget][valid[:budget]]),
            "gamma_f": pair_coverage(space, failures),
            "area": theta_area(failure_sequence(failed[:budget])),
            "regions": count_regions(space, failures, neighbours, min_failures),
        }
        row |= {f"{name}_{budget}": found[name] for name in MEASURES}
    return row


def count_regions(space: Space, failures: Floats, neighbours: float, min_failures: int) -> int:
    """Number of density clusters (DBSCAN) of failures (n, d) of all causes on the mixed distance."""
    if len(failures) < min_failures:
        return 0
    found = DBSCAN(
        eps=chance_radius(space, len(failures), neighbours),
        min_samples=min_failures,
        metric="precomputed",
    )
    return int(found.fit_predict(mixed_distance(space, failures, failures)).max()) + 1


def chance_radius(space: Space, failures: int, neighbours: float) -> float:
    """Radius in (0, 1] within which a failure would have this many neighbours on average if all failures were spread evenly over the space.

    Of few categories many points coincide: then coinciding points form a cluster.
    """
    if failures < 2:
        return 1.0
    probes = space.sample(PROBES, np.random.default_rng(0))
    distances = mixed_distance(space, probes, probes)[np.triu_indices(PROBES, 1)]
    radius = float(np.quantile(distances, min(1.0, neighbours / (failures - 1))))
    return radius or float(distances.min(initial=1.0, where=distances > 0)) / 2
