"""Progress reaches a log at most once a second, and always at the end."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from pipeline.progress import Progress


def test_a_log_gets_a_line_a_second_and_the_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0] + [i * 0.3 for i in range(1, 11)])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    log = tmp_path / "deep" / "step.log"
    with Progress("campaign", log) as progress:
        for done in range(1, 11):
            progress(done, 10, "2 failures")
    lines = log.read_text().splitlines()
    assert [line.split()[1] for line in lines] == ["1/10", "5/10", "9/10", "10/10"]
    assert "2 failures" in lines[-1] and "100%" in lines[-1]
