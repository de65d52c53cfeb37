"""`likelihood` as a person types it: rates of scenarios and of the system, resumed, reweighted, and
clear about wrong words."""

from __future__ import annotations

import re
import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from pipeline.__main__ import main
from pipeline.artefacts.files import write_json
from pipeline.artefacts.likelihood import read_rate, write_rate
from pipeline.artefacts.recorded_tests import tables_below
from pipeline.artefacts.tables import space_of_tests
from pipeline.commands.campaign import STOPPED
from pipeline.commands.likelihood import asked
from pipeline.core.likelihood.rate import Limits, Rate
from pipeline.errors import InputError
from pipeline.progress import Progress

ANALYTIC = ["simulator=analytic", "detector=oracle"]


def likelihood(folder: Path, *words: str) -> int:
    return main(["likelihood", "budget=120", *ANALYTIC, f"out={folder}", *words, "--threads", "1"])


def test_a_stopped_estimate_resumes_and_a_finished_one_executes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["scenario=F1,F2", "exposure=uniform"]

    def stop(self: Progress, done: int, total: int, text: str = "") -> None:
        if done == 30:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Progress, "__call__", stop)
        assert likelihood(tmp_path, "scenario=F1", "exposure=uniform") == STOPPED
    assert "the same command resumes" in capsys.readouterr().out
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "F1" / "journal").glob("*.npz")}
    assert len(kept) >= 30
    assert (
        likelihood(tmp_path, "scenario=F1", "exposure=uniform") == 0
        and not (tmp_path / "F1" / "journal").exists()
    )
    first = capsys.readouterr().out
    assert re.search(
        r"^F1: failure probability 0\.\d+, 95 % interval 0\.\d+ to 0\.\d+; \d+ of 120 tests fail$",
        first,
        re.MULTILINE,
    )
    assert re.search(
        r"^95 % sure: below .* under exposure 'uniform', after 120 tests$", first, re.MULTILINE
    )
    assert likelihood(tmp_path, "scenario=F1", "exposure=uniform") == 0
    again = capsys.readouterr()
    assert again.out == first and "120/120" not in again.err
    assert main(["likelihood", *words]) == 2
    assert "exposure: it has no share of scenario 'F1'" in capsys.readouterr().err


def test_a_folder_of_others_is_left_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (foreign := tmp_path / "F1").mkdir()
    (foreign / "notes.txt").write_text("mine")
    assert likelihood(tmp_path, "scenario=F1", "exposure=uniform") == 2
    assert (
        f"{foreign}: expected a new folder or that of a search, got one with notes.txt"
        in capsys.readouterr().err
    )
    assert [path.name for path in foreign.iterdir()] == ["notes.txt"]


def test_no_estimate_loses_the_tests_of_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["scenario=F1", "exposure=uniform"]
    assert likelihood(tmp_path, *words) == 0
    written = (tmp_path / "F1" / "rate.json").read_bytes()
    capsys.readouterr()
    assert likelihood(tmp_path, *words, "seed=1") == 2
    assert (
        "holds another search, or one by other code; choose another folder with out="
        in capsys.readouterr().err
    )
    assert (tmp_path / "F1" / "rate.json").read_bytes() == written
    overrides = {
        asked([*words, *more]).folder for more in ([], ["budget=200"], ["below=0.1"], ["seed=1"])
    }
    assert len(overrides) == 4


@pytest.mark.parametrize("wrong", [{"value": 1.2}, {"value": "0.1"}, {"limits": {}}, {"more": 1}])
def test_a_stored_rate_that_is_none_is_named(wrong: dict[str, Any], tmp_path: Path) -> None:
    path, rate = tmp_path / "rate.json", Rate(0.1, Limits(0.05, 0.2, 0.15), 100, 10)
    write_rate(path, "ours", rate)
    assert read_rate(path, "ours") == rate and read_rate(path, "another's") is None
    write_json(path, {"identity": "ours", **asdict(rate), **wrong})
    with pytest.raises(
        InputError,
        match=r"rate\.json: expected a failure rate, got another file; delete it and start again",
    ):
        read_rate(path, "ours")


def test_random_campaigns_are_weighed_and_searches_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for strategy in ("random", "forest"):
        words = [
            "scenario=F1",
            f"strategy={strategy}",
            "budget=60",
            *ANALYTIC,
            f"out={tmp_path / strategy}",
            "--threads",
            "1",
        ]
        assert main(["campaign", *words]) == 0
    capsys.readouterr()
    assert main(["likelihood", "exposure=town", "--from", str(tmp_path / "random")]) == 0
    printed = capsys.readouterr().out
    assert (
        "under this exposure, 60 uniform tests are worth" in printed
        and "failure probability unknown" in printed
        and "no claim" in printed
    )
    assert (
        main(["likelihood", "--from", str(tmp_path / "random"), "exposure=town"]) == 0
        and capsys.readouterr().out == printed
    )
    assert main(["likelihood", "--from", str(tmp_path / "random"), "exposure=twon"]) == 2
    assert "exposure: there is no 'twon'" in capsys.readouterr().err
    assert main(["likelihood", "--from", str(tmp_path / "random"), str(tmp_path / "rnadom")]) == 2
    assert (
        f"{tmp_path / 'rnadom'}: expected campaigns, found no tests.parquet"
        in capsys.readouterr().err
    )
    shutil.copytree(tmp_path / "random", tmp_path / "again" / "shards" / "0")
    assert main(["likelihood", "--from", str(tmp_path / "again")]) == 2
    (tmp_path / "again" / "shards").rename(tmp_path / "again" / "copy")
    capsys.readouterr()
    assert main(["likelihood", "--from", str(tmp_path / "random"), str(tmp_path / "again")]) == 2
    assert (
        "--from: F1-random-uniform-0-00000 is in two of the tables; leave one of them out"
        in capsys.readouterr().err
    )
    shutil.rmtree(tmp_path / "again")
    assert main(["likelihood", "exposure=town", "--from", str(tmp_path)]) == 2
    assert "expected tests of strategy 'random', got 'forest'" in capsys.readouterr().err


def test_random_tests_are_weighed_in_the_space_that_they_were_drawn_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for high in (50, 100):
        words = [
            "scenario=F1",
            "strategy=random",
            "budget=60",
            *ANALYTIC,
            f"scenarios.F1.space.fog.high={high}",
            "--threads",
            "1",
        ]
        assert main(["campaign", *words, f"out={tmp_path / str(high)}"]) == 0
    exposure = tmp_path / "dense.yaml"
    exposure.write_text(
        "description: Dense fog.\nvariables: {fog: {kind: histogram, edges: [50, 100], shares: "
        "[1], source: Assumed by this test.}}\n"
    )
    assert main(["likelihood", f"exposure={exposure}", "--from", str(tmp_path / "50")]) == 2
    assert "edges must rise within [0, 50]" in capsys.readouterr().err
    assert main(["likelihood", f"exposure={exposure}", "--from", str(tmp_path / "100")]) == 0
    assert main(["likelihood", "exposure=uniform", "--from", str(tmp_path)]) == 2
    assert (
        "--from: expected tests of one space of F1, got another one in " in capsys.readouterr().err
    )
    table = pq.read_table(path := tmp_path / "50" / "tests.parquet")
    pq.write_table(table.replace_schema_metadata({}), path)
    with pytest.raises(
        InputError,
        match=r"tests\.parquet: expected the space of its tests in its metadata; make the "
        r"campaign again",
    ):
        space_of_tests(path)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["exposure=twon"], "exposure: there is no 'twon'; did you mean 'town'?"),
        (["method=subsets"], "method: there is no 'subsets'; did you mean 'subset'?"),
        (["budget=99"], "budget: expected a whole number from 100 to 10000000, got '99'"),
        (
            ["seed=2147483648"],
            "seed: expected a whole number from 0 to 2147483647, got '2147483648'",
        ),
        (["below=2"], "below must be a number between 0 and 1, got '2'"),
        (
            ["below=0.1", "method=subset"],
            "below: only monte_carlo stops once a limit is settled, got method=subset",
        ),
        (["scenario=F1,F1"], "scenario: expected distinct scenarios, got F1,F1"),
        (
            ["scenario=all", "exposure=uniform"],
            "scenario=all: exposure 'uniform' has no shares of scenarios, so name them, as in",
        ),
        (["scenario=N1"], "scenario: N1 asks the ego not to brake"),
        (
            ["samplers.random.batch_size=9"],
            "samplers.random.batch_size=9: an estimator chooses the tests",
        ),
        (["campaign.tests=9"], "campaign.tests: has no effect here"),
        (["budget"], "expected key=value, got 'budget'"),
        (
            ["scenario=F1", "--from", "nowhere"],
            "scenario: --from executes nothing and weights the tests in its folders",
        ),
        (["aeb.votes=2", "--from", "nowhere"], "aeb.votes: --from executes nothing"),
        (["--from", "nowhere"], "nowhere: expected campaigns, found no tests.parquet"),
    ],
)
def test_wrong_words_are_told_before_any_work(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["likelihood", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("description: x\nvariables: {rain: {kind: uniform}}", "variables.rain: needs 'source'"),
        (
            "description: x\nscenarios: {source: 0123456789, shares: {F1: 0.5}}",
            "scenarios: shares must sum to 1, got 0.5",
        ),
        ("description: [", "not valid YAML"),
        ("description: café", "mine.yaml: expected UTF-8 text, got the byte 0xe9 at 16"),
        (
            "description: x\ndescription: y",
            "mine.yaml, line 2: not valid YAML (the key 'description' appears twice)",
        ),
        (
            "description: x\nvariables: {rian: {kind: uniform, source: none is known}}",
            "the space has no variable 'rian'; did you mean 'rain'?",
        ),
    ],
)
def test_wrong_exposure_files_are_told(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="latin-1")
    assert main(["likelihood", f"exposure={path}", f"out={tmp_path / 'rates'}", *ANALYTIC]) == 2
    assert message in capsys.readouterr().err


def test_a_project_in_a_folder_called_shards_has_its_tests(tmp_path: Path) -> None:
    below = tmp_path / "shards" / "project"
    for name in ("campaigns/0", "shards/campaigns/0"):
        (below / name).mkdir(parents=True)
        (below / name / "tests.parquet").touch()
    assert tables_below([below]) == [below / "campaigns/0/tests.parquet"]
