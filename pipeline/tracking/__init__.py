"""What MLflow gets of a study, and where it is kept. Light: nothing here imports MLflow."""

from __future__ import annotations

from pathlib import Path

STORE, ARTIFACTS = Path("data/mlflow/mlflow.db"), Path("data/mlflow/artifacts")
"""Store of the runs without MLFLOW_TRACKING_URI."""
UNTRACKED = ("scenarios", "front_car", "exposure")
"""Sections of a config that are no parameters of its runs: the bodies of scenarios are long, and the others change no run."""
