"""What a run of Snakemake checks before it begins, and its exit code.

It checks the config and its source, and that no other run is at work in the folder.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.run_lock import hold
from pipeline.config.composing import PARAMS, load
from pipeline.config.schema import Config
from pipeline.contract import REJECTED
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
    """The file of Snakemake's config.

    A file that `--configfile` names is read here too, because Snakemake accepts duplicate keys.
    """
    configfiles = workflow.config_settings.configfiles
    if not configfiles:
        return PARAMS
    path = Path(configfiles[-1])
    if workflow.is_main_process:
        load(path)
    return path


def check_source(config: Config, workflow: Workflow) -> None:
    """InputError if the command line changes the study: the verdict, DVC and all commands read
    params.yaml.

    It may name the params.yaml in the study's folder, as `test-detector` writes it.
    """
    if not workflow.is_main_process:
        return
    settings = workflow.config_settings
    params = Path(Folders(config).root, "params.yaml").absolute()
    option = ""
    if settings.config:
        option = "--config"
    elif any(Path(path).absolute() != params for path in settings.configfiles):
        option = "--configfile"
    if option:
        instead = "type: python -m pipeline compose study=NAME key=value, then ./run"
        raise InputError(f"{option} would change only a part of the study; {instead}")


def alone(workflow: Workflow) -> None:
    """Wait for another run in this folder, if this one executes jobs.

    Locks of Snakemake that are left then are those of killed runs, and are removed.
    """
    if not workflow.is_main_process or workflow.executor_plugin is None or workflow.dryrun:
        return
    hold("snakemake")
    REJECTED.unlink(missing_ok=True)
    for lock in LOCKS.glob("*.lock"):
        lock.unlink()


def fail() -> None:
    """Exit with 2 after a run in which a job rejected its input.

    After other failures, Snakemake exits with 1.
    """
    if REJECTED.exists():
        sys.exit(2)


def end(error: InputError) -> NoReturn:
    """Print the error in one line and exit with 2."""
    print(f"error: {one_line(error)}", file=sys.stderr)
    sys.exit(2)
