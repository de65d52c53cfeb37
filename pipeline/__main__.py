"""The command line. Bad input ends with one message and exit code 2.

People's commands are in pipeline/commands; one of them, `step`, is the door to a study's steps.
A campaign without a result ends with exit code 1.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path

from pipeline import commands, steps
from pipeline.commands import names_by_word
from pipeline.config.project import entered
from pipeline.errors import InputError, NoResultError, explained, missing_extra, one_line

PROGRAM = "blindspot" if Path(sys.argv[0]).name == "blindspot" else "python -m pipeline"
"""As the user called it: the installed command, or this module."""
ANYWHERE = ("coverage",)
"""The commands that need no project."""
RESUMABLE = ("step", "test-detector")
"""The commands that keep finished tests when Ctrl-C stops them, without a message of their own."""
COMMANDS, STEPS = names_by_word(commands), names_by_word(steps)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    command = words[0] if words else ""
    label = " ".join(words[:2]) if command == "step" else command
    try:
        with nullcontext() if command in ANYWHERE else entered():
            if command in STEPS and command not in COMMANDS:
                raise InputError(f"a step of a study; type: {PROGRAM} step {command}")
            options = read_options(parser(command), words)
            code: int = options.run(options)
        sys.stdout.flush()
    except BrokenPipeError:  # The reader closed the pipe, as in `| head`.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except KeyboardInterrupt:
        kept = "; finished tests are kept, and the same command resumes"
        stopped = "stopped" + (kept if command in RESUMABLE else "")
        print(f"blindspot {label}: {stopped}", file=sys.stderr)
        return 130
    except Exception as error:
        cause = missing_extra(error) if isinstance(error, ModuleNotFoundError) else explained(error)
        if cause is None:
            raise
        print(f"blindspot {one_line(f'{label}: {cause}')}", file=sys.stderr)
        return 1 if isinstance(cause, NoResultError) else 2
    return code


def parser(only: str = "") -> argparse.ArgumentParser:
    """The parser of all commands, or of a single one; then the others are not imported."""
    top = argparse.ArgumentParser(
        PROGRAM, description="Finds, explains and fixes the blind spots of a camera detector."
    )
    words = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for word in [only] if only in COMMANDS else COMMANDS:
        try:
            command = import_module(f"pipeline.commands.{COMMANDS[word]}")
        except ModuleNotFoundError as error:
            if word == only:
                raise
            words.add_parser(word, help=str(missing_extra(error)))
            continue
        added = words.add_parser(word, help=command.HELP, description=command.HELP)
        command.arguments(added)
        added.set_defaults(run=command.run)
    return top


def read_options(top: argparse.ArgumentParser, words: Sequence[str]) -> argparse.Namespace:
    """The options of a command.

    argparse takes no key=value words on both sides of an option; those that it leaves are added.
    """
    options, rest = top.parse_known_args(words)
    accepts_words = hasattr(options, "words")
    wrong = [word for word in rest if word[:1] == "-" or "=" not in word or not accepts_words]
    if wrong:
        hint = f"; the step of a study is `step {words[0]}`" if words[0] in STEPS else ""
        top.error(f"unrecognized arguments: {' '.join(wrong)}{hint}")
    if rest:
        options.words += rest
    return options


if __name__ == "__main__":
    sys.exit(main())
