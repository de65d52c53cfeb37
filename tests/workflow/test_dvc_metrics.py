"""`dvc metrics show` reads a folder of metrics, and nothing that Snakemake leaves in it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

from pipeline.artefacts.files import write_json

ROOT = Path(__file__).resolve().parents[2]


def dvc(folder: Path, *words: str) -> str:
    return subprocess.run(
        [sys.executable, "-m", "dvc", *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    ).stdout


def test_a_row_is_a_version_or_a_search(tmp_path: Path) -> None:
    dvc(tmp_path, "init", "--no-scm", "--quiet")
    shutil.copy(ROOT / ".dvcignore", tmp_path)
    (tmp_path / "dvc.yaml").write_text("metrics: [metrics]\n")
    rows = {
        "metrics/held_out/base.json": {"failures": 3},
        "metrics/search/F1-random.json": {"failures": 1},
    }
    for name, row in rows.items():
        write_json(tmp_path / name, row)
    (tmp_path / "metrics/.snakemake_timestamp").touch()
    shown = json.loads(dvc(tmp_path, "metrics", "show", "--json"))[""]["data"]
    assert {name: row["data"] for name, row in shown.items()} == rows
