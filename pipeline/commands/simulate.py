"""Command `simulate`: one concrete scenario to a replay, in seconds."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from pipeline.config.composing import compose, functional_scenario
from pipeline.config.project import typed
from pipeline.core import kpi
from pipeline.core.episode import Episode
from pipeline.core.names import nearest
from pipeline.core.space import Space, Value
from pipeline.errors import InputError, SimulationError
from pipeline.execution.pool import Pool
from pipeline.execution.worker import Broken, Calls
from pipeline.execution.workers import Setup, guarded

PLAIN: Mapping[str, Value] = {
    "rain": 0, "fog": 0, "sun_azimuth": 120, "sun_altitude": 45, "pedestrian_shift": 0, "pedestrian_speed": 1.4, "animation": "walking",
}  # fmt: skip
"""Defaults of variables that are not assigned: a walk on a sunny day."""


HELP = "Execute one concrete scenario and write its replay."


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenario", help="name of a file in conf/scenario, such as F1")
    parser.add_argument(
        "assignments", nargs="*", metavar="key=value", help="scenario variables, such as fog=80 'blueprint=M 03'; others have defaults"
    )
    parser.add_argument("--model", type=typed, default=Path("models/uniform"), help="folder of a model version (default: %(default)s)")
    parser.add_argument("--out", type=typed, default="replay.mp4", help=".mp4 or .gif (default: %(default)s)")


def run(options: argparse.Namespace) -> int:
    """Execute the scenario with the detector, write the replay and print the result as one line."""
    from pipeline.detectors.yolo.export import onnx_of
    from pipeline.report.replays import Replay, check_replay, render_replay

    check_replay(options.out)
    described = functional_scenario(options.scenario)
    space = described.logical_space()
    concrete = concrete_scenario(space, options.assignments)
    study = compose("default", [] if described.asks_to_brake else ["aeb.gate=detections"])
    with tempfile.TemporaryDirectory() as folder:
        onnx = onnx_of(options.model, Path(folder))
        episode = executed(Setup(study.simulator, described, study.detector, onnx, study.car, study.limits, keep_every=1), concrete)
    threshold = study.campaign.failure_threshold_s
    title = f"{described.label}, detector {options.model}"
    replay = Replay(episode, title, concrete, threshold, space.units)
    render_replay(replay, options.out, replay.frames_per_second)
    result = kpi.evaluate(episode.signals, threshold)
    print(f"{options.out}: {result.failure_mode if result.failure else 'no failure'}, adj. TTC {result.adj_ttc_s:.2f} s")
    return 0


def executed(setup: Setup, concrete: Mapping[str, Value]) -> Episode:
    """The episode of a concrete scenario, from a process with the limits of a test; InputError if it fails or is over a limit."""
    with Pool(1, partial(_execution, setup), setup.limits) as pool:
        _, said = next(pool.run([concrete]))
    if isinstance(said, Broken):
        raise InputError(f"the scenario cannot be executed: {said.reason}")
    return said


def _execution(setup: Setup, calls: Calls) -> Callable[[Mapping[str, Value]], Episode]:
    simulator, detector = guarded(setup, calls)

    def execute(concrete: Mapping[str, Value]) -> Episode:
        try:
            return simulator.execute(concrete, detector, setup.keep_every)
        except SimulationError as error:
            raise InputError(f"the scenario cannot be executed: {error}") from error

    return execute


def concrete_scenario(space: Space, assignments: Sequence[str]) -> dict[str, Value]:
    """A value for each variable of the space; InputError for unknown names and values."""
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
        return space.decode(space.encode(values))  # Types as in a campaign: the values' text, 0 or 0.0, seeds rain and grain.
    except ValueError as error:
        raise InputError(str(error)) from error
