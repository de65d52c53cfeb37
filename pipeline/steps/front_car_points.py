"""Step `front_car_points`: draws random points and proposes points until all cells are covered.

Cells are the feasible ones of Cheng et al., section 5.
"""

from __future__ import annotations

import numpy as np

from pipeline.artefacts.front_car_results import CoveredPoint, Points
from pipeline.artefacts.results import write
from pipeline.contract import Job, Step
from pipeline.errors import InputError

STEP = Step(
    "Draw random points of the front-car domain and propose points to full coverage.",
    writes=lambda folders: {"points": f"{folders.root}/points.json"},
    sections=("front_car.space", "front_car.k", "front_car.existing", "front_car.seed"),
)


def run(job: Job) -> None:
    """Write points.json: E1, E2, ... drawn without replacement, then G1, G2, ... proposed."""
    from pipeline.core.coverage.projection import Demand, projection_coverage
    from pipeline.core.coverage.proposals import Proposer

    settings = job.config.front_car
    space, feasible = settings.space.space(), settings.space.feasible_points()
    if settings.existing > len(feasible):
        raise InputError(
            f"front_car.existing must be at most {len(feasible)}, the number of feasible points; "
            f"got {settings.existing}"
        )
    rng = np.random.default_rng(settings.seed)
    points = feasible[rng.choice(len(feasible), settings.existing, replace=False)]
    demand = Demand(space.constraints, settings.k)
    for proposal in Proposer(demand).complete(points, exact=True):
        points = np.vstack([points, proposal.categories])
    covered, required = [], 0
    for i in range(len(points)):
        coverage = projection_coverage(points[: i + 1], demand)
        required = coverage.required
        point = space.decode(space.representatives(points[i : i + 1])[0])
        values = {name: str(value) for name, value in point.items()}
        name = f"E{i + 1}" if i < settings.existing else f"G{i + 1 - settings.existing}"
        covered.append(CoveredPoint(name=name, values=values, covered=coverage.covered))
        job.progress(i + 1, len(points), f"{name}: {coverage.covered} of {required} cells")
    result = Points(
        k=settings.k, existing=settings.existing, required=required, points=tuple(covered)
    )
    write(job.output("points"), result)
