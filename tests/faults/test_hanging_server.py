"""An MLflow server that takes a connection but never answers ends a run soon."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.tracking import client


def test_a_server_that_hangs_is_named_soon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "ANSWER_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"http://127.0.0.1:{server.getsockname()[1]}"
        monkeypatch.setenv("MLFLOW_TRACKING_URI", address)
        with pytest.raises(
            InputError,
            match=f"^MLflow at {address} does not answer within 0.3 s; "
            "the same command resumes once it does$",
        ):
            client.connect(tmp_path / "mlflow.db")
