"""The connection to MLflow: the server of MLFLOW_TRACKING_URI, or an SQLite file."""

from __future__ import annotations

import logging
import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.client import HTTPException
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.error import URLError
from urllib.request import urlopen

from pipeline.errors import InputError

if TYPE_CHECKING:
    from mlflow import MlflowClient

ANSWER_S = 20.0
"""Longest time that a server may take for its first answer."""


def server() -> str | None:
    """The address in MLFLOW_TRACKING_URI; None if it is missing or empty."""
    return os.environ.get("MLFLOW_TRACKING_URI") or None


def connect(store: Path) -> MlflowClient:
    """A client of the server or, without a server, of an SQLite file.

    Args:
        store: The SQLite file; it is made if it is missing.

    Raises:
        InputError: The server does not answer, or the file is damaged.
    """
    if (address := server()) is not None:
        check_answer(address)
    elif store.exists():
        _check_store(store)
    os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
    os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")
    # Without this, MLflow waits minutes for a server that does not answer.
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "3")

    # The store's migrations log a hundred lines on first use.
    logging.getLogger("alembic").setLevel(logging.WARNING)
    if address is None and not store.exists():
        # MLflow's migrations cannot resume after a kill: the store gets its name once it is whole.
        making = store.with_name(f".{store.name}.making")
        store.parent.mkdir(parents=True, exist_ok=True)
        making.unlink(missing_ok=True)
        _client(f"sqlite:///{making.resolve()}").search_experiments(max_results=1)
        with making.open("rb") as file:
            os.fsync(file.fileno())
        making.rename(store)
    return _client(address or f"sqlite:///{store.resolve()}")


def _client(uri: str) -> MlflowClient:
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri, registry_uri=uri)


def _check_store(store: Path) -> None:
    """InputError if SQLite finds the file damaged or a migration was interrupted.

    The file has no digest of ours, because it changes with every run.
    """
    half_migrated = "SELECT name FROM sqlite_master WHERE name LIKE '\\_alembic\\_tmp%' ESCAPE '\\'"
    try:
        with closing(sqlite3.connect(store)) as database:
            state = str(database.execute("PRAGMA integrity_check(1)").fetchone()[0])
            if table := database.execute(half_migrated).fetchone():
                state = f"a migration was interrupted at {table[0]}"
    except sqlite3.Error as error:
        state = str(error)
    if state != "ok":
        again = f"mv {store} {store}.damaged && ./run --forcerun track"
        raise InputError(
            f"{store}: damaged ({state.splitlines()[-1]}); to register this study's versions in a "
            f"new one, type: {again}"
        )


def check_answer(address: str) -> None:
    """Check that a server answers in time; MLflow itself would wait for minutes.

    MLflow reports other faults soon.

    Raises:
        InputError: The server does not answer within `ANSWER_S`.
    """
    if not address.startswith(("http://", "https://")):
        return
    try:
        urlopen(f"{address.rstrip('/')}/health", timeout=ANSWER_S).close()
    except (OSError, ValueError, HTTPException) as error:
        reason = error.reason if isinstance(error, URLError) else error
        if isinstance(reason, TimeoutError):
            raise InputError(
                f"MLflow at {address} does not answer within {ANSWER_S:g} s; the same command "
                "resumes once it does"
            ) from error


@contextmanager
def usable(store: Path) -> Iterator[None]:
    """Turn an error of MLflow inside the block into an InputError."""
    from mlflow.exceptions import MlflowException

    try:
        yield
    except MlflowException as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"MLflow at {server() or store} cannot be used: {reason}") from error
