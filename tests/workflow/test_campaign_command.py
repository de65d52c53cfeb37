"""`campaign` as a person types it: live, stopped by Ctrl-C, resumed, and clear about wrong words."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from pipeline.__main__ import main
from pipeline.commands.campaign import STOPPED

WORDS = ["scenario=F1", "strategy=forest", "budget=40", "simulator=analytic", "detector=oracle"]


def command(folder: Path) -> list[str]:
    return [sys.executable, "-m", "pipeline", "campaign", *WORDS, f"out={folder}", "--threads", "1"]


def test_a_stopped_campaign_resumes_and_ends_like_an_uninterrupted_one(tmp_path: Path) -> None:
    cut, whole = tmp_path / "cut", tmp_path / "whole"
    stopped = subprocess.Popen(command(cut), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while stopped.poll() is None and len(list((cut / "journal").glob("*.npz"))) < 3:
        pass
    stopped.send_signal(signal.SIGINT)
    out, errors = stopped.communicate()
    assert stopped.returncode == STOPPED, errors
    assert "Traceback" not in errors and f"finished tests are in {cut}/journal, and the same command resumes" in out
    assert not (cut / "tests.parquet").exists()
    for folder in (cut, whole):
        done = subprocess.run(command(folder), capture_output=True, text=True, check=True)
        assert re.search(r"40/40 100% .* failures \(\d+%\), \d+ kinds", done.stderr)
        assert re.search(r"^\d+ of 40 tests fail\n\d+ kinds .*causes: ", done.stdout)
    pd.testing.assert_frame_equal(pd.read_parquet(cut / "tests.parquet"), pd.read_parquet(whole / "tests.parquet"))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["budget=none"], "budget must be a whole number from 1, got 'none'"),
        (["seed=-1"], "seed must be a whole number from 0, got '-1'"),
        (["strategy=forst"], "strategy: there is no 'forst'; did you mean 'forest'?"),
        (["scenario=F99"], "F99"),
        (["budget"], "expected key=value, got 'budget'"),
        (["camera=big"], "camera"),
        (["--threads", "0"], "--threads must be at least 1, got 0"),
    ],
)
def test_wrong_words_are_told_before_any_work(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", *words]) == 2
    assert told in capsys.readouterr().err
