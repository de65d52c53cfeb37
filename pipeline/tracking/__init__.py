"""The runs and model versions of a study in MLflow, the only room that imports it.

`client` connects, `runs` and `registry` write, `contents` describes a study for both, `champion`
moves the alias, `served_model` makes a version loadable. This file itself imports no MLflow.
"""

from __future__ import annotations

from pathlib import Path

STORE, ARTIFACTS = Path("data/mlflow/mlflow.db"), Path("data/mlflow/artifacts")
"""Store of the runs without MLFLOW_TRACKING_URI."""
UNTRACKED = ("scenarios", "front_car", "exposure")
"""Sections of a config that are no parameters of its runs.

The bodies of scenarios are long, and the other sections change no run."""
