"""Command `simulate`: one concrete scenario to a replay, in seconds."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.config.composing import study_of
from pipeline.config.project import typed
from pipeline.core import kpi
from pipeline.core.names import nearest
from pipeline.core.space import Space, Value
from pipeline.errors import InputError
from pipeline.execution.workers import Setup, episode

PLAIN: Mapping[str, Value] = {
    "rain": 0,
    "fog": 0,
    "sun_azimuth": 120,
    "sun_altitude": 45,
    "pedestrian_shift": 0,
    "pedestrian_speed": 1.4,
    "animation": "walking",
}
"""Defaults of variables that are not assigned: a walk on a sunny day."""


HELP = "Execute one concrete scenario and write its replay."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("scenario", help="name of a file in conf/scenario, such as F1")
    parser.add_argument(
        "words",
        nargs="*",
        metavar="key=value",
        help="scenario variables, such as fog=80 'blueprint=M 03'; others have defaults",
    )
    parser.add_argument(
        "--model",
        type=typed,
        default=Path("models/uniform"),
        help="folder of a model version (default: %(default)s)",
    )
    parser.add_argument(
        "--out", type=typed, default="replay.mp4", help=".mp4 or .gif (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Execute the scenario with the detector, write the replay and print the result as one line."""
    from pipeline.detectors.yolo.export import onnx_of
    from pipeline.report.replays import Replay, check_replay, outcome_text, render_replay

    check_replay(options.out)
    study = study_of(options.scenario)
    space = study.space(options.scenario)
    concrete = concrete_scenario(space, options.words)
    with tempfile.TemporaryDirectory() as folder:
        model = onnx_of(options.model, Path(folder))
        driven = episode(Setup.of(study, options.scenario, model, keep_every=1), concrete)
    threshold_s = study.campaign.failure_threshold_s
    title = f"{study.scenarios[options.scenario].label}, detector {options.model}"
    replay = Replay(driven, title, concrete, threshold_s, space.units)
    render_replay(replay, options.out, replay.frames_per_second)
    result = kpi.evaluate(driven.signals, threshold_s)
    print(f"{options.out}: {outcome_text(result)}, adj. TTC {result.adj_ttc_s:.2f} s")
    return 0


def concrete_scenario(space: Space, assignments: Sequence[str]) -> dict[str, Value]:
    """A value for each variable of the space; InputError for unknown names and values."""
    values: dict[str, Value] = {
        v.name: PLAIN.get(v.name, v.decode(v.low) if v.kind != "categorical" else v.values[0])
        for v in space.variables
    }
    given: dict[str, str] = {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if name not in values:
            raise InputError(f"there is no variable '{name}'{nearest(name, values)}")
        if not equals:
            raise InputError(f"write {name}=VALUE, got '{assignment}'")
        if name in given:
            raise InputError(f"{name} is given twice: {given[name]} and {text}")
        given[name] = text
        variable = next(v for v in space.variables if v.name == name)
        try:
            values[name] = text if variable.kind == "categorical" else float(text)
        except ValueError as error:
            raise InputError(f"{name}: expected a number, got '{text}'") from error
    try:
        return space.decode(space.encode(values))  # 0 and 0.0 are one scenario.
    except ValueError as error:
        raise InputError(str(error)) from error
