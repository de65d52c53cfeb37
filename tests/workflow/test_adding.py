"""Adding a KPI or a signal changes its declaration and its computation; the rest follows."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.studies import ROOT, StudyFolder, arguments

CAMPAIGN = Path("data", "smoke", "campaigns", "F1", "random", "base", "0")
KPI = {
    "pipeline/core/kpi.py": {
        "\n\nKPIS = ": '    duration_s: float = column("time of the last step", "s")\n\n\nKPIS = ',
        "        missed_frames=": '        duration_s=float(signals["time_s"][-1]),\n        '
        "missed_frames=",
    }
}
SIGNAL = {
    "pipeline/core/signals.py": {
        "\n\nSignals = ": '    jerk_mps3: float = column("jerk of the ego", "m/s³")\n\n\nSignals = '
    },
    "pipeline/core/loop.py": {"        ego_y_m=": "        jerk_mps3=1.5,\n        ego_y_m="},
}


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package with one more KPI and signal, and a campaign with it on the analytic
    simulator."""
    root = tmp_path_factory.mktemp("changed")
    for folder in ("pipeline", "conf", "docs", "models", "tools"):
        shutil.copytree(
            ROOT / folder,
            root / folder,
            symlinks=True,
            ignore=shutil.ignore_patterns("__pycache__", "images"),
        )
    for name, edits in (KPI | SIGNAL).items():
        text = (root / name).read_text()
        for old, new in edits.items():
            assert text.count(old) == 1
            text = text.replace(old, new)
        (root / name).write_text(text)
    StudyFolder.composed(
        root, "smoke", ["simulator=analytic", "detector=oracle", "campaign.tests=4"]
    )
    model = root / "data" / "smoke" / "models" / "base" / "model.onnx"
    model.parent.mkdir(parents=True)
    model.write_bytes(b"the oracle needs none")
    run(root, "-m", "pipeline", *arguments("define-space", scenario="F1"))
    run(
        root,
        "-m",
        "pipeline",
        *arguments(
            "campaign", kind="campaigns", scenario="F1", strategy="random", version="base", seed=0
        ),
    )
    run(root, "tools/reference.py")
    return root


def run(root: Path, *command: str) -> None:
    done = subprocess.run(
        [sys.executable, *command],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_a_kpi_is_declared_once(changed: Path) -> None:
    table = pq.read_table(changed / CAMPAIGN / "tests.parquet")
    assert table.schema.field("duration_s").metadata == {b"unit": b"s"}
    assert min(table.column("duration_s").to_pylist()) > 0
    assert (
        "| `duration_s` | float | s | time of the last step |"
        in (changed / "docs" / "reference" / "columns.md").read_text()
    )


def test_a_signal_is_declared_once(changed: Path) -> None:
    table = pq.read_table(changed / CAMPAIGN / "signals.parquet")
    assert table.schema.field("jerk_mps3").metadata == {b"unit": "m/s³".encode()}
    assert set(table.column("jerk_mps3").to_pylist()) == {1.5}
    assert (
        "| `jerk_mps3` | float | m/s³ | jerk of the ego |"
        in (changed / "docs" / "reference" / "columns.md").read_text()
    )
