"""Tracking through a real `mlflow server` with a PostgreSQL store, or SQLite without PostgreSQL."""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.error import URLError

import pytest

from pipeline.__main__ import main
from pipeline.tracking.registry import Registration, Registry
from pipeline.tracking.runs import Content, DataSet, Tracker


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def postgresql() -> Iterator[str]:
    """A separate database server; as the user postgres if the tests run as root."""
    user = []
    if os.getuid() == 0:
        user = ["setpriv", "--reuid=postgres", "--regid=postgres", "--clear-groups"]
    # Not in pytest's folder, which every start of pytest closes to other users.
    with TemporaryDirectory() as folder:
        data = Path(folder) / "postgresql"
        data.mkdir(mode=0o700)
        if user:
            Path(folder).chmod(0o755)
            shutil.chown(data, "postgres", "postgres")
        with running(user, data) as address:
            yield address


@contextmanager
def running(user: list[str], data: Path) -> Iterator[str]:
    """A database server on a free port. user: words before its commands."""
    port = free_port()

    def call(*words: str) -> None:
        subprocess.run(
            [*user, *words],
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=data,
        )

    call("initdb", "-D", str(data), "-U", "blindspot", "--auth=trust")
    start = ("pg_ctl", "-D", str(data), "-w", "-t", "300", "-l", str(data / "log"))
    call(*start, "-o", f"-p {port} -h 127.0.0.1 -k {data}", "start")
    try:
        yield f"postgresql+pg8000://blindspot@127.0.0.1:{port}/postgres"
    finally:
        call("pg_ctl", "-D", str(data), "-m", "immediate", "-t", "300", "stop")


def has_postgresql() -> bool:
    if not (shutil.which("initdb") and shutil.which("pg_ctl")):
        return False
    return os.getuid() != 0 or (
        shutil.which("setpriv") is not None
        and "postgres" in {user.pw_name for user in pwd.getpwall()}
    )


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    with ExitStack() as stack:
        store = (
            stack.enter_context(postgresql())
            if has_postgresql()
            else f"sqlite:///{tmp_path / 'server.db'}"
        )
        port = free_port()
        command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", store]
        command += ["--host", "127.0.0.1", "--port", str(port)]
        command += [
            "--workers",
            "1",
            "--artifacts-destination",
            str(tmp_path / "server"),
            "--serve-artifacts",
        ]
        environment = {**os.environ, "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"}
        log = stack.enter_context((tmp_path / "server.log").open("wb"))
        process = subprocess.Popen(
            command, stdout=log, stderr=log, env=environment, start_new_session=True
        )
        stack.callback(process.wait, timeout=30)
        stack.callback(os.killpg, process.pid, signal.SIGTERM)
        address = f"http://127.0.0.1:{port}"
        for _ in range(240):
            assert process.poll() is None, (tmp_path / "server.log").read_text()
            try:
                urllib.request.urlopen(f"{address}/health", timeout=2).close()
                break
            except (URLError, ConnectionError, TimeoutError):
                time.sleep(0.5)
        monkeypatch.setenv("MLFLOW_TRACKING_URI", address)
        yield address


def test_a_server_stores_runs_and_versions_once(
    server: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import mlflow

    weights = tmp_path / "model.json"
    weights.write_text("{}")
    tracker = Tracker(tmp_path / "none.db", tmp_path / "none", "blindspot/remote", {})
    registry = Registry(tracker)
    study = tracker.log(Content("remote", "study", params={f"key{i}": "value" for i in range(150)}))
    data = DataSet("base_set", "ab" * 32, "data/remote/base_set", "training")
    series = {"training.ap50": [(step, step / 2000) for step in range(1000)]}
    content = Content(
        "remote/base",
        "model",
        {"version": "base"},
        {"failures": 7.0},
        series,
        files=[weights],
        data=[data],
    )
    registration = Registration(
        "detector", content, [weights], {"study": "remote", "version": "base", "failures": "7"}
    )
    number, run_id = registry.register(registration, study)
    assert (number, run_id) == registry.register(registration, study)
    campaign = tracker.log(Content("remote/F1", "campaign"), study)
    registry.link("detector", number, [campaign])
    registry.set_alias("detector", "champion", number)
    tracker.describe(study, "text", [run_id])

    client = mlflow.MlflowClient(server)
    assert len(client.get_metric_history(run_id, "training.ap50")) == 1000
    assert client.get_run(run_id).data.tags["mlflow.parentRunId"] == study
    assert client.get_run(run_id).inputs.dataset_inputs[0].dataset.name == "base_set"
    assert client.get_run(campaign).data.tags["model_version"] == f"detector/{number}"
    assert [artifact.path for artifact in client.list_artifacts(run_id)] == ["model.json"]
    assert main(["versions"]) == 0
    assert capsys.readouterr().out.splitlines()[1].split()[:3] == ["detector", "1", "base"]
    assert not (tmp_path / "none.db").exists() and not (tmp_path / "none").exists()
