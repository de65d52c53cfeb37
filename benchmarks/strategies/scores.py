"""What one campaign found after each budget."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.core.measures import failure_sequence, kinds_of, pair_coverage, theta_area
from pipeline.core.regions import NOISE, chance_radius, find_regions
from pipeline.core.space import Floats, Space

BUDGETS = (120, 300, 1000)
"""Numbers of tests after which campaigns are compared."""
MEASURES = ("failures", "kinds", "gamma_t", "gamma_f", "area", "regions")


def scores(space: Space, points: Floats, kpi: Floats, threshold_s: float, neighbours: float, min_failures: int) -> dict[str, Any]:
    """The measures of a campaign's tests in order, (n, d) and (n,): for each budget up to n `failures_120`, `kinds_120` and so on.

    failed_at: positions of the failures, from 1. errors: tests without a KPI; they used budget. neighbours, min_failures: see
    `pipeline.core.regions`.
    """
    failed, valid = kpi <= threshold_s, np.isfinite(kpi)  # NaN is not a failure.
    row: dict[str, Any] = {"errors": int((~valid).sum()), "failed_at": (np.flatnonzero(failed) + 1).tolist()}
    for budget in (budget for budget in BUDGETS if budget <= len(kpi)):
        failures = points[:budget][failed[:budget]]
        found = {
            "failures": len(failures),
            "kinds": kinds_of(space, failures),
            "gamma_t": pair_coverage(space, points[:budget][valid[:budget]]),
            "gamma_f": pair_coverage(space, failures),
            "area": theta_area(failure_sequence(failed[:budget])),
            "regions": _regions(space, failures, neighbours, min_failures),
        }
        row |= {f"{name}_{budget}": found[name] for name in MEASURES}
    return row


def _regions(space: Space, failures: Floats, neighbours: float, min_failures: int) -> int:
    if len(failures) < min_failures:
        return 0
    return int(find_regions(space, failures, chance_radius(space, len(failures), neighbours), min_failures).max(initial=NOISE)) + 1
