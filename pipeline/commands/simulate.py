"""Command `simulate`: one concrete scenario to a replay, in seconds."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from hydra.utils import instantiate

from pipeline.config.composing import compose, functional_scenario
from pipeline.core import kpi
from pipeline.core.names import nearest
from pipeline.core.space import Space, Value
from pipeline.errors import InputError
from pipeline.protocols import Detector

PLAIN: Mapping[str, Value] = {
    "rain": 0, "fog": 0, "sun_azimuth": 120, "sun_altitude": 45, "pedestrian_shift": 0, "pedestrian_speed": 1.4, "animation": "walking",
    "blueprint": "W 07",
}  # fmt: skip
"""A walk on a sunny day: what is not assigned."""


def run(scenario: str, assignments: Sequence[str], *, model: Path, out: Path) -> str:
    """Execute it with the detector in `model` and write the replay to `out`, .mp4 or .gif; returns the result in a line.

    scenario: a file's name in conf/scenario. assignments: key=value for scenario variables; what is missing is plain.
    """
    from pipeline.detectors.yolo.export import onnx_of
    from pipeline.report.replays import render_replay

    if out.suffix not in (".mp4", ".gif"):
        raise InputError(f"--out: a replay is an .mp4 or a .gif, got {out.name}")
    described = functional_scenario(scenario)
    space = Space.from_dict(described.space)
    concrete = concrete_scenario(space, assignments)
    study = compose("default", [])
    with tempfile.TemporaryDirectory() as folder:
        onnx = onnx_of(model, Path(folder))
        simulator = instantiate(study.simulator, scenario=described.model_dump(), _convert_="all")
        detector: Detector = instantiate(study.detector, model=onnx, _convert_="all")
        episode = simulator.execute(concrete, detector, keep_every=1)
        simulator.close()
    threshold = study.campaign.failure_threshold_s
    units = {variable.name: variable.unit for variable in space.variables}
    title = f"{described.label}, detector {model}"
    render_replay(episode, title, concrete, out, failure_threshold_s=threshold, units=units, frames_per_second=10)
    result = kpi.evaluate(episode.signals, threshold)
    return f"{out}: {result.failure_mode if result.failure else 'no failure'}, adj. TTC {result.adj_ttc_s:.2f} s"


def concrete_scenario(space: Space, assignments: Sequence[str]) -> dict[str, Value]:
    """A value for each variable of the space; InputError for what is not in it."""
    values: dict[str, Value] = {
        v.name: PLAIN.get(v.name, v.decode(v.low) if v.kind != "categorical" else v.values[0]) for v in space.variables
    }
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if name not in values:
            raise InputError(f"there is no variable '{name}'{nearest(name, values)}")
        if not equals:
            raise InputError(f"write {name}=VALUE, got '{assignment}'")
        variable = next(v for v in space.variables if v.name == name)
        try:
            values[name] = text if variable.kind == "categorical" else float(text)
        except ValueError as error:
            raise InputError(f"{name}: expected a number, got '{text}'") from error
    try:
        return space.decode(space.encode(values))  # As a campaign has it: rain and grain are drawn by the values' text, 0 or 0.0.
    except ValueError as error:
        raise InputError(str(error)) from error
