"""What a run of Snakemake checks before it begins: the config, its source, and that no other run is at work; and its exit code."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.run_lock import hold
from pipeline.config.composing import PARAMS, load
from pipeline.config.schema import Config
from pipeline.contract import REFUSED
from pipeline.errors import InputError, one_line

if TYPE_CHECKING:
    from snakemake.workflow import Workflow

LOCKS = Path(".snakemake/locks")
"""Snakemake's own locks, which outlive a killed run."""


def checked(params: str) -> str:
    """The path of a valid params.yaml; an error is one line instead of Snakemake's stack trace."""
    try:
        load(Path(params))
    except InputError as error:
        end(error)
    return params


def params_of(workflow: Workflow) -> Path:
    """The file of Snakemake's config. One that `--configfile` names is read here too: Snakemake takes a key that stands twice."""
    given = workflow.config_settings.configfiles
    path = Path(given[-1]) if given else PARAMS
    if given and workflow.is_main_process:
        load(path)
    return path


def check_source(config: Config, workflow: Workflow) -> None:
    """InputError if the command line changes the study: the verdict, DVC and all commands read params.yaml. A study that has one in its own
    folder, as those of test-detector, may be named by it."""
    if not workflow.is_main_process:
        return
    given = workflow.config_settings
    own = Path(Folders(config).root, "params.yaml").absolute()
    named = (
        "--config"
        if given.config
        else next(
            ("--configfile" for path in given.configfiles if Path(path).absolute() != own), ""
        )
    )
    if named:
        instead = "type: python -m pipeline compose study=NAME key=value, then ./run"
        raise InputError(f"{named} would change only a part of the study; {instead}")


def alone(workflow: Workflow) -> None:
    """Wait for another run in this folder, if this one executes jobs; a lock that is left then is a killed run's."""
    if not workflow.is_main_process or workflow.executor_plugin is None or workflow.dryrun:
        return
    hold("snakemake")
    REFUSED.unlink(missing_ok=True)
    for left in LOCKS.glob("*.lock"):
        left.unlink()


def fail() -> None:
    """Exit with 2 after a run in which a job refused its input; other failures leave Snakemake's exit code, 1."""
    if REFUSED.exists():
        sys.exit(2)


def end(error: InputError) -> NoReturn:
    """Print the error in one line and exit with 2."""
    print(f"error: {one_line(error)}", file=sys.stderr)
    sys.exit(2)
