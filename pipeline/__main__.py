"""The command line: `compose`, every step of the pipeline, and `verdict`. Bad input ends with one message and exit code 2."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline import config as configuration
from pipeline.progress import Progress
from pipeline.protocols import InputError

Options = dict[str, dict[str, Any]]
ONE: dict[str, Any] = {"type": Path}
MANY: dict[str, Any] = {"type": Path, "nargs": "*"}
TEXT: dict[str, Any] = {"type": str}
NUMBER: dict[str, Any] = {"type": int}

STEPS: dict[str, tuple[str, Options]] = {
    "define-space": ("Write the logical scenario space of a scenario.", {"scenario": TEXT, "out": ONE}),
    "render-base": ("Render the random base training set.", {"out": ONE, "threads": NUMBER}),
    "train": ("Train or adopt the base detector.", {"base-set": ONE, "out": ONE, "threads": NUMBER}),
    "campaign": (
        "Execute a test campaign in closed loop; resumes from its journal.",
        {
            "scenario": TEXT, "strategy": TEXT, "version": TEXT, "seed": NUMBER, "space": ONE, "model": ONE, "out": ONE, "journal": ONE,
            "threads": NUMBER,
        },
    ),
    "measure": ("Measure the search campaigns.", {"tests": MANY, "spaces": MANY, "out": ONE, "theta": ONE}),
    "cluster": ("Group the failures of a scenario into regions.", {"tests": MANY, "space": ONE, "out": ONE}),
    "filter": ("Decide which campaign frames may be learnt from.", {"frames": MANY, "out": ONE}),
    "retrain": (
        "Retrain a model version on the base set and campaign frames.",
        {"version": TEXT, "base-set": ONE, "parent": ONE, "filters": MANY, "frames": MANY, "out": ONE, "threads": NUMBER},
    ),
    "compare": (
        "Compare all model versions on the held-out sequence.",
        {"tests": MANY, "spaces": MANY, "models": MANY, "measures": ONE, "out": ONE, "table": ONE, "metrics": ONE},
    ),
    "track": (
        "Log everything to MLflow and register the model versions.",
        {"models": MANY, "measures": ONE, "comparison": ONE, "campaigns": MANY, "plots": MANY, "store": ONE, "artifacts": ONE, "out": ONE},
    ),
    "report": (
        "Write the report, its plots and replays.",
        {
            "measures": ONE, "comparison": ONE, "table": ONE, "regions": MANY, "tests": MANY, "spaces": MANY, "filters": MANY,
            "models": MANY, "detectors": MANY, "out": ONE, "plots": ONE,
        },
    ),
}  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    top = argparse.ArgumentParser("python -m pipeline", description="Finds, explains and mends the blind spots of a camera detector.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    compose = commands.add_parser("compose", help="Compose conf/ into params.yaml.")
    compose.add_argument("words", nargs="+", metavar="study=NAME", help="the study, then Hydra overrides such as campaign.tests=100")
    compose.add_argument("--out", type=Path, default=configuration.PARAMS)
    verdict = commands.add_parser("verdict", help="Print the table of the comparison.")
    verdict.add_argument("--comparison", type=Path, required=True)
    for name, (text, options) in STEPS.items():
        step = commands.add_parser(name, help=text, description=text)
        for option, how in options.items():
            step.add_argument(f"--{option}", required=True, **how)
        step.add_argument("--params", type=Path, default=configuration.PARAMS, help="resolved configuration (default: %(default)s)")
        step.add_argument("--log", type=Path, help="file that progress is written to, a line a second at most")
    return top


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit code."""
    options = vars(parser().parse_args(arguments))
    command = options.pop("command")
    try:
        if command == "compose":
            _compose(options["words"], options["out"])
        elif command == "verdict":
            _verdict(options["comparison"])
        else:
            _step(command, options)
    except InputError as error:
        print(f"blindspot {command}: {error}", file=sys.stderr)
        return 2
    return 0


def _compose(words: list[str], out: Path) -> None:
    study = [word.removeprefix("study=") for word in words if word.startswith("study=")]
    if len(study) != 1:
        raise InputError(f"name one study, as in `compose study=default`; got {' '.join(words)}")
    config = configuration.compose(study[0], [word for word in words if not word.startswith("study=")])
    out.write_text(configuration.dump(config, f"python -m pipeline compose {' '.join(words)}"))
    print(f"{out}: study {config.study}")


def _verdict(comparison: Path) -> None:
    from pipeline.artefacts.results import Comparison, read
    from pipeline.report.verdict import verdict_table

    print(verdict_table(read(comparison, Comparison), comparison.with_name("report.html")))


def _step(command: str, options: dict[str, Any]) -> None:
    config, log = configuration.load(options.pop("params")), options.pop("log")
    step = import_module(f"pipeline.steps.{command.replace('-', '_')}")
    with Progress(command, log) as progress:
        try:
            step.run(config, **options, progress=progress)
        except InputError as error:
            progress.record(str(error))
            raise


if __name__ == "__main__":
    sys.exit(main())
