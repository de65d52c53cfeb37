"""Command `explore`: serves the finished report locally and films any test on demand."""

from __future__ import annotations

import argparse
import errno
from collections.abc import Mapping
from pathlib import Path

from pipeline.artefacts.folders import Folders
from pipeline.config.composing import PARAMS, check_study, load
from pipeline.config.schema import Config
from pipeline.errors import InputError

HELP = "Serve the report of a finished study to this machine alone; clicking a test makes its film."
PORT = 8765


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "study", nargs="?", metavar="STUDY", help="default: the study in params.yaml"
    )
    parser.add_argument(
        "--port",
        type=int,
        default=PORT,
        help="port on 127.0.0.1; 0 takes a free one (default: %(default)s)",
    )


def run(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    from pipeline.report.films_on_demand import FilmsOnDemand
    from pipeline.report.report_server import ADDRESS, ReportServer, served

    config, params = chosen(options.study)
    folders = Folders(config)
    pages = pages_of(folders)
    for page in pages.values():
        served(page)
    try:
        server = ReportServer(options.port, pages, FilmsOnDemand(folders, params))
    except OverflowError as error:
        raise InputError(f"--port must be in [0, 65535], got {options.port}") from error
    except OSError as error:
        problem = f"cannot be used ({error.strerror})"
        if error.errno == errno.EADDRINUSE:
            problem = f"is taken; choose another one, as in --port {options.port + 1}"
        raise InputError(f"--port: {options.port} {problem}") from error
    with server:
        address = f"http://{ADDRESS}:{server.port}/"
        print(
            f"The report of study {config.study} is at {address} (stop it with Ctrl-C)", flush=True
        )
        server.serve_forever()
    return 0


def chosen(study: str | None) -> tuple[Config, Path]:
    """The configuration of a study, and its file.

    The file is in the study's folder if `test-detector` wrote it; otherwise it is params.yaml.
    """
    params = Path("data", study or "", "params.yaml")
    if not study or not params.is_file():
        params = PARAMS
    config = load(params)
    if study not in (None, config.study):
        check_study(study)
        command = f"python -m pipeline compose study={study}"
        raise InputError(
            f"{params} holds study {config.study}, expected {study}; "
            f"type: {command}, with the overrides that it was made with"
        )
    return config, params


def pages_of(folders: Folders) -> Mapping[str, Path]:
    """The pages with a table of tests, by their addresses.

    Raises:
        InputError: the study has no such page, or is not finished.
    """
    study = folders.config.study
    if folders.config.goal not in ("report", "detectors"):
        raise InputError(
            f"study {study} has no report of tests; it makes {', '.join(folders.goals)}"
        )
    paths = [Path(goal) for goal in folders.goals if goal.endswith(".html")]
    missing = next((path for path in paths if not path.is_file()), None)
    if missing is not None:
        raise InputError(
            f"{missing}: no such file, so study {study} is not finished; "
            "finish it first (./run, or the same test-detector)"
        )
    return {f"/{path.relative_to(folders.root).as_posix()}": path for path in paths}
