"""The command line: all commands and all steps. Bad input ends with one message and exit code 2, a campaign without a result with 1."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

from pipeline import commands, steps
from pipeline.config.arguments import whole
from pipeline.config.project import entered, typed
from pipeline.core.names import check_name, nearest
from pipeline.errors import InputError, NoResultError, explained, missing_extra, one_line, shown

if TYPE_CHECKING:
    from pipeline.config.schema import Config
    from pipeline.contract import Step

PROGRAM = "blindspot" if Path(sys.argv[0]).name == "blindspot" else "python -m pipeline"
"""As the user called it: the installed command, or this module."""
ANYWHERE = ("coverage",)
"""The commands that need no project."""
RESUMES = "finished tests are kept, and the same command resumes"
BY_HAND = "by hand"
"""The stamp of a step that a person ran: Snakemake makes its files again, because it cannot know their inputs."""


def names(package: Any) -> dict[str, str]:
    """The modules of a package by their names on the command line."""
    return {module.name.replace("_", "-"): module.name for module in iter_modules(package.__path__)}


def parser(only: str = "") -> argparse.ArgumentParser:
    """The parser of all commands and steps, or of one command; then the others are not imported."""
    top = argparse.ArgumentParser(
        PROGRAM, description="Finds, explains and fixes the blind spots of a camera detector."
    )
    words = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    known = names(commands)
    for word, name in known.items() if only not in known else [(only, known[only])]:
        try:
            command = import_module(f"pipeline.commands.{name}")
        except ModuleNotFoundError as error:
            if only == word:
                raise
            words.add_parser(word, help=str(missing_extra(error)))
            continue
        added = words.add_parser(word, help=command.HELP, description=command.HELP)
        command.arguments(added)
        added.set_defaults(run=command.run)
    for word, name in names(steps).items() if only not in known else ():
        if word in known:
            continue
        words.add_parser(word, help=step_help(name), add_help=False)
    return top


def step_help(name: str) -> str:
    """The help of a step, or the missing extra that it needs."""
    try:
        return str(import_module(f"pipeline.steps.{name}").STEP.help)
    except ModuleNotFoundError as error:
        return str(missing_extra(error))


def calls_step(words: Sequence[str]) -> bool:
    """Whether the words call a step. Where a command has the same name, the step is the one with `--kind`."""
    first = words[0] if words else ""
    return first in names(steps) and (
        first not in names(commands) or any(word.startswith("--kind") for word in words)
    )


def run_step(name: str, arguments: Sequence[str]) -> int:
    """Run one step by hand on the files of the study; its wildcards become options."""
    from pipeline.artefacts.folders import Folders
    from pipeline.config.components import check_components
    from pipeline.config.composing import PARAMS, load
    from pipeline.contract import order_of, perform, step_of

    step = step_of(name)
    options = argparse.ArgumentParser(
        f"{PROGRAM} {name.replace('_', '-')}", description=step.help, add_help=False
    )
    options.add_argument(
        "--params", type=typed, default=PARAMS, help="resolved configuration (default: %(default)s)"
    )
    config = load(options.parse_known_args(arguments)[0].params)
    wildcards = step.names(Folders(config))
    options.add_argument("--help", "-h", action="help", help="show this message and exit")
    options.add_argument("--threads", type=whole(1), default=1, help="default: %(default)s")
    for wildcard in wildcards:
        options.add_argument(f"--{wildcard}", required=True, help=step.wildcards.get(wildcard))
    given = vars(options.parse_args(arguments))
    for wildcard in wildcards:
        check_wildcard(wildcard, given[wildcard], step, config)
    check_components(config)
    perform(
        order_of(
            name,
            config,
            {wildcard: given[wildcard] for wildcard in wildcards},
            BY_HAND,
            given["threads"],
        ),
        config,
    )
    return 0


def check_wildcard(wildcard: str, value: str, step: Step, config: Config) -> None:
    """InputError for a value that the step does not take, that cannot be in a path, or that the study does not know."""
    from pipeline.contract import PATTERNS

    if (pattern := {**PATTERNS, **step.wildcards}.get(wildcard)) is not None:
        if not re.fullmatch(pattern, value):
            raise InputError(f"--{wildcard}: expected {pattern}, got {shown(value)}")
    else:
        try:
            check_name(value, "-")
        except ValueError as error:
            raise InputError(f"--{wildcard}: {error}") from error
    known = config.wildcards.get(wildcard, [value])
    if wildcard not in step.wildcards and value not in known:
        raise InputError(f"--{wildcard}: there is no {shown(value)}{nearest(value, known)}")


def read_options(top: argparse.ArgumentParser, words: Sequence[str]) -> argparse.Namespace:
    """The options of a command. argparse takes no key=value words on both sides of an option, so those that it leaves are added here."""
    options, left = top.parse_known_args(words)
    if wrong := [
        word
        for word in left
        if word.startswith("-") or "=" not in word or not hasattr(options, "words")
    ]:
        top.error(f"unrecognized arguments: {' '.join(wrong)}")
    if left:
        options.words += left
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command or a step; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    first = words[0] if words else ""
    try:
        with nullcontext() if first in ANYWHERE else entered():
            if calls_step(words):
                return run_step(names(steps)[first], words[1:])
            options = read_options(parser(first), words)
            code: int = options.run(options)
        sys.stdout.flush()
    except BrokenPipeError:  # The reader has seen enough, as in `| head`.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except KeyboardInterrupt:
        goes_on = f"; {RESUMES}" if calls_step(words) or first == "test-detector" else ""
        print(f"blindspot {first}: stopped{goes_on}", file=sys.stderr)
        return 130
    except Exception as error:
        said = missing_extra(error) if isinstance(error, ModuleNotFoundError) else explained(error)
        if said is None:
            raise
        print(f"blindspot {one_line(f'{first}: {said}')}", file=sys.stderr)
        return 1 if isinstance(said, NoResultError) else 2
    return code


if __name__ == "__main__":
    sys.exit(main())
