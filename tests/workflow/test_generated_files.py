"""The generated files in the repository are what the code and conf/ say today."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from pipeline.commands import stages
from pipeline.config.composing import PARAMS, compose, load

ROOT = Path(__file__).resolve().parents[2]


def test_params_are_what_their_first_line_composes() -> None:
    command = PARAMS.read_text().splitlines()[0].split("`")[1]
    study, *overrides = command.partition(" compose study=")[2].split()
    assert load(PARAMS) == compose(study, overrides), f"conf/ has changed since; compose again: {command}"


def test_the_reference_is_up_to_date() -> None:
    done = subprocess.run([sys.executable, ROOT / "docs" / "generate.py", "--check"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_dvc_yaml_is_what_the_contracts_say() -> None:
    assert (ROOT / "dvc.yaml").read_text() == stages.text(), "make dvc.yaml again: python -m pipeline stages"
