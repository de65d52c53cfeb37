"""Progress reaches a log at most once a second and at the end, with the time left."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from pipeline.progress import Progress


def test_a_log_gets_a_line_a_second_and_the_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0] + [i * 0.3 for i in range(1, 11)])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    log = tmp_path / "deep" / "step.log"
    with Progress("campaign", log) as progress:
        for done in range(1, 11):
            progress(done, 10, "2 failures")
    lines = log.read_text().splitlines()
    assert [line.split()[1] for line in lines] == ["1/10", "5/10", "9/10", "10/10"]
    assert "2 failures" in lines[-1] and "100%" in lines[-1]


def test_the_time_left_leaves_out_the_start_and_what_was_done_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Started at 0 s; 20 s until the first report of a resumed run, then ten a second; another part
    # begins at 40 s.
    clock = iter([0.0, 20.0, 22.0, 24.0, 40.0, 42.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    log = tmp_path / "step.log"
    with Progress("campaign", log) as progress:
        for done in (900, 920, 1000, 1, 3):
            progress(done, 1000)
    left = [line.split(" s, ")[1] for line in log.read_text().splitlines()]
    assert left == ["--:-- left", "00:08 left", "00:00 left", "--:-- left", "16:37 left"]
