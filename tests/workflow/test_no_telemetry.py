"""No library reports anything: importing `pipeline` turns their telemetry off."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.studies import ROOT

ASK = """
import pipeline
import dvc.analytics, huggingface_hub.constants
from mlflow.telemetry.utils import is_telemetry_disabled
hub_is_silent = huggingface_hub.constants.HF_HUB_DISABLE_TELEMETRY
print(dvc.analytics.is_enabled(), hub_is_silent, is_telemetry_disabled())
"""
ONNX = "import pipeline.detectors.onnx, time; time.sleep(1)"


def run(script: str, home: Path) -> str:
    """Run a script as a user with an empty home and no settings."""
    environment = {"HOME": str(home), "PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=home,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_dvc_hugging_face_and_mlflow_say_that_they_report_nothing(tmp_path: Path) -> None:
    assert run(ASK, tmp_path) == "False True True"


def test_onnx_runtime_collects_no_events(tmp_path: Path) -> None:
    run(ONNX, tmp_path)
    assert not [path for path in tmp_path.rglob("*") if "onnxruntime" in path.name]
