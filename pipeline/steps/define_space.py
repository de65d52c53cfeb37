"""Step `define_space`: writes the logical scenario space of a functional scenario.

The file also has the number of pairs that coverage counts.
"""

from __future__ import annotations

from pipeline.artefacts.scenario_space import ScenarioInfo, write_space
from pipeline.contract import Job, Step
from pipeline.scenarios.people import fingerprint

STEP = Step(
    "Write the logical scenario space of a scenario.",
    writes=lambda folders: {"space": folders.space("{scenario}")},
    sections=("scenarios.{scenario}",),
)


def run(job: Job) -> None:
    """Write the space of the scenario with its number of pairs of categories."""
    from pipeline.core.measures import feasible_pairs

    name = job.wildcards["scenario"]
    body, space = job.config.scenarios[name], job.config.space(name)
    pairs, people = feasible_pairs(space), "" if body.people is None else fingerprint(body.people)
    info = ScenarioInfo(
        name,
        body.label,
        body.description,
        pairs,
        body.town.fingerprint,
        people,
        asks_to_brake=body.asks_to_brake,
    )
    write_space(job.output("space"), info, space)
    job.progress(1, 1, f"{len(space)} variables, {pairs} pairs")
