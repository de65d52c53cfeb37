"""Command `step`: one step of a study's workflow, by hand."""

from __future__ import annotations

import argparse
import re

from pipeline import steps
from pipeline.commands import names_by_word
from pipeline.config.arguments import whole
from pipeline.config.project import typed
from pipeline.config.schema import Config
from pipeline.contract import PATTERNS, Step
from pipeline.core.names import check_name, nearest
from pipeline.errors import InputError, missing_extra, shown

HELP = "Run one step of a study's workflow by hand; without a name, list the steps."
BY_HAND = "by hand"
"""The stamp of a step that a person ran: Snakemake makes its files again, because it cannot know
their inputs."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("step", nargs="?", choices=names_by_word(steps), metavar="STEP")
    parser.add_argument(
        "rest",
        nargs=argparse.REMAINDER,
        metavar="--OPTION VALUE",
        help="the wildcards in the paths of the step's files; `step STEP --help` lists them",
    )
    parser.set_defaults(program=parser.prog)


def run(options: argparse.Namespace) -> int:
    """Run the step on the files of the study, or list all steps."""
    from pipeline.artefacts.folders import Folders
    from pipeline.config.components import check_components
    from pipeline.config.composing import PARAMS, load
    from pipeline.contract import order_of, perform, step_of

    if options.step is None:
        for word, name in names_by_word(steps).items():
            try:
                text = step_of(name).help
            except ModuleNotFoundError as error:
                text = str(missing_extra(error))
            print(f"{word:21}{text}")
        return 0
    name = names_by_word(steps)[options.step]
    step = step_of(name)
    program = f"{options.program} {options.step}"
    parser = argparse.ArgumentParser(program, description=step.help, add_help=False)
    parser.add_argument(
        "--params", type=typed, default=PARAMS, help="resolved configuration (default: %(default)s)"
    )
    config = load(parser.parse_known_args(options.rest)[0].params)
    parser.add_argument("--help", "-h", action="help", help="show this message and exit")
    parser.add_argument("--threads", type=whole(1), default=1, help="default: %(default)s")
    for wildcard in step.names(Folders(config)):
        parser.add_argument(f"--{wildcard}", required=True, help=step.wildcards.get(wildcard))
    values = vars(parser.parse_args(options.rest))
    wildcards = {wildcard: values[wildcard] for wildcard in step.names(Folders(config))}
    for wildcard, value in wildcards.items():
        check_wildcard(wildcard, value, step, config)
    check_components(config)
    perform(order_of(name, config, wildcards, BY_HAND, values["threads"]), config)
    return 0


def check_wildcard(wildcard: str, value: str, step: Step, config: Config) -> None:
    """InputError for a value that the step or the study does not have, or that no path can hold."""
    pattern = {**PATTERNS, **step.wildcards}.get(wildcard)
    if pattern is not None:
        if not re.fullmatch(pattern, value):
            raise InputError(f"--{wildcard}: expected {pattern}, got {shown(value)}")
    else:
        try:
            check_name(value, "-")
        except ValueError as error:
            raise InputError(f"--{wildcard}: {error}") from error
    values = config.wildcards.get(wildcard, [value])
    if wildcard not in step.wildcards and value not in values:
        raise InputError(f"--{wildcard}: there is no {shown(value)}{nearest(value, values)}")
