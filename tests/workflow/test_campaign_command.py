"""`campaign` as a person types it: live, stopped by Ctrl-C, resumed, clear about wrong words."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from pipeline.__main__ import main
from pipeline.artefacts.files import read_sealed, write_sealed
from pipeline.artefacts.job_lock import held
from pipeline.commands.campaign import STOPPED, asked, planned

WORDS = ["scenario=F1", "strategy=forest", "budget=60", "simulator=analytic", "detector=oracle"]


def campaign(folder: Path) -> int:
    return main(["campaign", *WORDS, f"out={folder}", "--threads", "1"])


def test_a_stopped_campaign_resumes_and_ends_like_an_uninterrupted_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut, whole = tmp_path / "cut", tmp_path / "whole"
    command = [sys.executable, "-m", "pipeline", "campaign", *WORDS, f"out={cut}", "--threads", "2"]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
    while len(list((cut / "journal").glob("*.npz"))) < 3:
        assert run.poll() is None
        time.sleep(0.002)
    os.killpg(run.pid, signal.SIGINT)  # As a terminal does, to the workers, too.
    message = run.communicate(timeout=30)[0]
    assert run.returncode == STOPPED and not (cut / "tests.parquet").exists()
    assert f"finished tests are in {cut}/journal, and the same command resumes" in message
    for folder in (cut, whole):
        assert campaign(folder) == 0 and not (folder / "journal").exists()
        printed = capsys.readouterr()
        assert re.search(r"60/60 100% .* failures \(\d+%\), \d+ kinds", printed.err)
        assert re.search(r"^\d+ of 60 tests fail\n\d+ kinds .*causes: ", printed.out)
    pd.testing.assert_frame_equal(
        pd.read_parquet(cut / "tests.parquet"), pd.read_parquet(whole / "tests.parquet")
    )


def test_a_finished_search_is_neither_executed_again_nor_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert campaign(tmp_path) == 0
    times = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.parquet")}
    capsys.readouterr()
    assert campaign(tmp_path) == 0
    assert "has this search already" in capsys.readouterr().out
    assert main(["campaign", *WORDS[:2], "budget=40", *WORDS[3:], f"out={tmp_path}"]) == 2
    assert "holds another search, or one by other code" in capsys.readouterr().err
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.parquet")} == times
    for name in ("tests.parquet", "timings.parquet"):
        (tmp_path / name).unlink()
        assert campaign(tmp_path) == 0 and (tmp_path / name).exists()


def test_a_journal_that_a_kill_left_beside_a_finished_search_is_removed(tmp_path: Path) -> None:
    assert campaign(tmp_path) == 0
    (tmp_path / "journal").mkdir()
    assert campaign(tmp_path) == 0 and not (tmp_path / "journal").exists()


def test_two_versions_searched_in_one_folder_are_two_detectors(tmp_path: Path) -> None:
    words = ["scenario=F1", "strategy=random", f"out={tmp_path}"]
    first, second = (
        planned(asked([*words, f"model=models/{name}"])) for name in ("uniform", "long_tailed")
    )
    assert (
        first.setup.model != second.setup.model
        and first.setup.model.exists()
        and first.identity != second.identity
    )


def test_no_search_loses_the_tests_of_another_or_files_of_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unfinished, foreign = tmp_path / "unfinished", tmp_path / "foreign"
    write_sealed(unfinished / "journal" / "identity", b"of another search")
    write_sealed(foreign / "tests.parquet", b"of somebody else")
    assert campaign(unfinished) == 2
    assert (
        f"{unfinished} holds another search, or one by other code; choose another folder"
        in capsys.readouterr().err
    )
    assert campaign(foreign) == 2
    assert (
        f"{foreign}: expected a new folder or that of a search, got one with tests.parquet"
        in capsys.readouterr().err
    )
    assert [path.name for path in foreign.iterdir()] == ["tests.parquet"]
    assert (unfinished / "journal" / "identity").exists() and read_sealed(
        foreign / "tests.parquet"
    ) == b"of somebody else"


def test_a_search_resumes_after_a_kill_while_it_exports_its_detector(tmp_path: Path) -> None:
    (tmp_path / ".0123456789abcdef.onnx.4242.tmp").touch()
    assert campaign(tmp_path) == 0


def test_words_may_stand_before_and_after_options(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*WORDS[:3], "--threads", "1", *WORDS[3:], f"out={tmp_path}"]
    assert main(["campaign", *words]) == 0
    assert "of 60 tests fail" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2"):
        main(["campaign", *words, "--budget=9"])
    assert "unrecognized arguments: --budget=9" in capsys.readouterr().err


def test_a_second_process_waits_and_finds_the_search_done(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "pipeline",
        "campaign",
        *WORDS,
        f"out={tmp_path}",
        "--threads",
        "1",
    ]
    with held(tmp_path / "lock", lambda: None):
        second = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert (
            second.stderr is not None and "waiting for another process" in second.stderr.readline()
        )
        assert not (tmp_path / "journal").exists()
    assert second.wait(timeout=60) == 0 and (tmp_path / "tests.parquet").exists()
    assert not (tmp_path / "lock").exists()


def test_overrides_of_the_scenario_and_of_the_strategy_count(tmp_path: Path) -> None:
    words = ["scenario=F1", "strategy=network", f"out={tmp_path}", "model=models/uniform"]
    overridden = ["scenarios.F1.ego.speed_kmh=20", "samplers.network.batch_size=7"]
    plain, changed = (planned(asked([*words, *overrides])) for overrides in ((), overridden))
    assert plain.setup.scenario.ego.speed_kmh == 32 and changed.setup.scenario.ego.speed_kmh == 20
    assert changed.strategy["batch_size"] == 7 and plain.space == changed.space


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["budget=none"], "budget: expected a whole number from 1 to 10000000, got 'none'"),
        (["seed=-1"], "seed: expected a whole number from 0 to 2147483647, got '-1'"),
        (
            ["seed=2147483648"],
            "seed: expected a whole number from 0 to 2147483647, got '2147483648'",
        ),
        ([f"seed={'9' * 5000}"], "seed: expected a whole number from 0 to 2147483647, got '999"),
        (["budget=5", "budget=7"], "budget is given twice: 5 and 7"),
        (["scenario=F1,F2"], "scenario: there is no conf/scenario/F1,F2.yaml"),
        (["strateg=forest"], "unknown key 'strateg'; did you mean 'strategy'?"),
        (["strategy=forst"], "strategy: there is no 'forst'; did you mean 'forest'?"),
        (["scenario=F99"], "F99"),
        (["budget"], "expected key=value, got 'budget'"),
        (["camera=big"], "camera"),
        (
            ["campaign.tests=9"],
            "campaign.tests: has no effect here; this command only uses scenarios.F1",
        ),
        (
            ["samplers.network.batch_size=9"],
            "samplers.network.batch_size: has no effect here",
        ),
        (["search=[F2]"], "search: has no effect here"),
    ],
)
def test_wrong_words_are_told_before_any_work(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["campaign", *words]) == 2
    assert message in capsys.readouterr().err
