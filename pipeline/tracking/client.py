"""The connection to MLflow: the server that MLFLOW_TRACKING_URI names, else an SQLite file in the project."""

from __future__ import annotations

import logging
import os
import sqlite3
from contextlib import closing
from http.client import HTTPException
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.error import URLError
from urllib.request import urlopen

from pipeline.errors import InputError

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException

ANSWER_S = 20.0
"""Longest time that a server may take for its first answer."""


def server() -> str | None:
    """The address of the server, None if there is none."""
    return os.environ.get("MLFLOW_TRACKING_URI")


def connect(store: Path) -> MlflowClient:
    """A client of the server or, without one, of the SQLite file `store`; InputError if the server does not answer or the file is
    damaged."""
    if (address := server()) is not None:
        check_answer(address)
    elif store.exists():
        _check(store)
    os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
    os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")
    # Without this, MLflow waits minutes for a server that does not answer.
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "3")
    from mlflow import MlflowClient

    # The store's migrations log a hundred lines on first use.
    logging.getLogger("alembic").setLevel(logging.WARNING)
    uri = server() or f"sqlite:///{store.resolve()}"
    return MlflowClient(tracking_uri=uri, registry_uri=uri)


def _check(store: Path) -> None:
    """SQLite's own check: its file has no digest, because it changes with every run."""
    try:
        with closing(sqlite3.connect(store)) as database:
            found = str(database.execute("PRAGMA integrity_check(1)").fetchone()[0])
    except sqlite3.Error as error:
        found = str(error)
    if found != "ok":
        said = found.splitlines()[-1]
        again = f"mv {store} {store}.damaged && ./run --forcerun track"
        raise InputError(f"{store}: damaged ({said}); to register this study's versions in a new one, type: {again}")


def check_answer(address: str) -> None:
    """InputError if a server keeps us waiting: MLflow itself would wait for minutes. It tells other faults soon."""
    if not address.startswith(("http://", "https://")):
        return
    try:
        urlopen(f"{address.rstrip('/')}/health", timeout=ANSWER_S).close()
    except (OSError, ValueError, HTTPException) as error:
        reason = error.reason if isinstance(error, URLError) else error
        if isinstance(reason, TimeoutError):
            raise InputError(f"MLflow at {address} does not answer within {ANSWER_S:g} s; the same command goes on once it does") from error


def unusable(store: Path, error: MlflowException) -> InputError:
    """The error to raise when MLflow fails."""
    return InputError(f"MLflow at {server() or store} cannot be used: {str(error).splitlines()[0]}")
