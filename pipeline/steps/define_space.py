"""Step `define_space`: the logical scenario space of a functional scenario, with what coverage will count."""

from __future__ import annotations

from pathlib import Path

from pipeline.artefacts.scenario_space import ScenarioInfo, write_space
from pipeline.config.schema import Config
from pipeline.progress import Progress


def run(config: Config, *, scenario: str, out: Path, progress: Progress) -> None:
    """Write the space of `scenario` with its number of pairs of categories."""
    body, space = config.scenarios[scenario], config.space(scenario)
    sizes = space.sizes
    pairs = sum(a * b for i, a in enumerate(sizes) for b in sizes[i + 1 :])
    write_space(out, ScenarioInfo(scenario, body.label, body.description, pairs, body.town.fingerprint), space)
    progress(1, 1, f"{len(space)} variables, {pairs} pairs")
