"""`explore` serves the report and films of the study's tests to this machine, and nothing else to
nobody else."""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import chdir, contextmanager
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from threading import Event, Thread
from typing import Any
from urllib.parse import unquote

import pytest

from pipeline.__main__ import main
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.tables import read_tests, write_tests
from pipeline.config.composing import functional_scenario, load
from pipeline.report.films_on_demand import FilmsOnDemand, MadeFilm
from pipeline.report.page import Page, render
from pipeline.report.report_server import ReportServer
from tests.studies import StudyFolder

ANALYTIC = ["simulator=analytic", "detector=oracle", "campaign.tests=4", "seeds=[0]"]
TESTS = [f"F1-random-base-0-0000{index}" for index in range(4)]
TABLE = "campaigns/F1/random/base/0/tests.parquet"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StudyFolder]:
    """A study with one real campaign and an empty report; the tests work in its folder."""
    folder = StudyFolder.composed(tmp_path_factory.mktemp("study"), "smoke", ANALYTIC)
    assert folder.run("define-space", scenario="F1") == 0
    (folder / "models/base").mkdir(parents=True)
    (folder / "models/base/model.onnx").write_bytes(b"the oracle needs none")
    assert (
        folder.run(
            "campaign", kind="campaigns", scenario="F1", strategy="random", version="base", seed=0
        )
        == 0
    )
    (folder / "report.html").write_text(render(Page("smoke", "Found nothing.", ())))
    with chdir(folder.root):
        yield folder


@pytest.fixture
def films(study: StudyFolder) -> FilmsOnDemand:
    return FilmsOnDemand(Folders(load()), Path("params.yaml"))


@contextmanager
def serving(study: StudyFolder, films: FilmsOnDemand) -> Iterator[ReportServer]:
    with ReportServer(0, {"/report.html": study / "report.html"}, films) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


@pytest.fixture
def server(study: StudyFolder, films: FilmsOnDemand) -> Iterator[ReportServer]:
    with serving(study, films) as running:
        yield running


def ask(
    server: ReportServer, path: str, method: str = "GET", headers: Mapping[str, str] = {}
) -> tuple[HTTPResponse, bytes]:
    connection = HTTPConnection("127.0.0.1", server.port, timeout=120)
    connection.request(method, path, headers=dict(headers))
    answer = connection.getresponse()
    return answer, answer.read()


def test_the_page_may_fetch_and_play_films_only_when_it_is_served(
    server: ReportServer, study: StudyFolder
) -> None:
    answer, _ = ask(server, "/")
    assert (answer.status, answer.getheader("Location")) == (302, "/report.html")
    answer, body = ask(server, "/report.html")
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]+)"', body.decode())
    assert answer.status == 200 and b"data-served" in body
    assert policy.split("; ")[:4] == [
        "default-src 'none'",
        "img-src data:",
        "media-src data: blob:",
        "connect-src 'self'",
    ]
    stored = (study / "report.html").read_text()
    assert "data-served" not in stored and "connect-src" not in stored and "blob:" not in stored


def test_a_film_is_made_once(
    server: ReportServer, study: StudyFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer, body = ask(server, f"/films/{TESTS[1]}.mp4")
    assert (answer.status, answer.getheader("Content-Type"), answer.getheader("X-Changed")) == (
        200,
        "video/mp4",
        None,
    )
    (kept,) = (study / "films").iterdir()
    assert kept.read_bytes() == body and body[4:8] == b"ftyp"
    monkeypatch.setattr(FilmsOnDemand, "_replay", None)
    assert ask(server, f"/films/{TESTS[1]}.mp4")[1] == body


def test_a_film_that_ends_otherwise_says_so_and_is_not_kept(
    server: ReportServer, study: StudyFolder
) -> None:
    rows, space = read_tests(study / TABLE), functional_scenario("F1").logical_space()
    (study / f"{TABLE}.stamp").unlink()
    write_tests(study / TABLE, rows.assign(false_positives=7), space)
    answer, body = ask(server, f"/films/{TESTS[2]}.mp4")
    assert answer.status == 200 and body[4:8] == b"ftyp"
    assert unquote(str(answer.getheader("X-Changed"))).endswith("s, false_positives 0 instead of 7")
    assert not list((study / "films").glob(f"*{TESTS[2]}*"))
    write_tests(study / TABLE, rows.assign(status="error", reason="planted"), space)
    answer, body = ask(server, f"/films/{TESTS[2]}.mp4")
    assert (answer.status, body) == (
        404,
        f"{TESTS[2]} ended in an error, so there is nothing to replay: planted".encode(),
    )
    write_tests(study / TABLE, rows, space)


def test_what_changed_may_be_in_any_script(
    server: ReportServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        FilmsOnDemand, "film", lambda *_: MadeFilm(b"film", "0 instead of 7 …, 100 % 行人")
    )
    answer, body = ask(server, f"/films/{TESTS[1]}.mp4")
    assert (answer.status, body, unquote(str(answer.getheader("X-Changed")))) == (
        200,
        b"film",
        "0 instead of 7 …, 100 % 行人",
    )


def test_a_new_film_replaces_the_one_of_another_study(
    films: FilmsOnDemand, study: StudyFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = study / f"films/{TESTS[3]}.0123456789abcdef.mp4"
    old.parent.mkdir(exist_ok=True)
    old.write_bytes(b"of other settings")
    monkeypatch.setattr(
        FilmsOnDemand, "_replay", lambda self, test, new: new.write_bytes(b"film") and ""
    )
    film = films.film(TESTS[3], lambda: True)
    assert film is not None and film.video == b"film" and not old.exists()
    shutil.rmtree(old.parent)


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:{port}",
        "127.0.0.1",
        "127.0.0.1:1",
        "localhost.evil.example:{port}",
        "",
    ],
)
@pytest.mark.parametrize("path", ["/", "/report.html", f"/films/{TESTS[0]}.mp4"])
def test_a_foreign_host_is_refused(server: ReportServer, host: str, path: str) -> None:
    answer, body = ask(server, path, headers={"Host": host.format(port=server.port)})
    assert answer.status == 403
    assert body.decode() == f"This server answers only at http://127.0.0.1:{server.port}."


def test_a_foreign_page_gets_no_film(server: ReportServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FilmsOnDemand, "film", None)
    assert (
        ask(server, f"/films/{TESTS[0]}.mp4", headers={"Sec-Fetch-Site": "cross-site"})[0].status
        == 403
    )
    assert ask(server, "/report.html")[0].getheader("Cross-Origin-Resource-Policy") == "same-origin"


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "HEAD", "OPTIONS"])
def test_only_get_is_answered(server: ReportServer, method: str) -> None:
    assert ask(server, f"/films/{TESTS[0]}.mp4", method)[0].status == 501


@pytest.mark.parametrize(
    "path",
    [
        "/params.yaml",
        "/../params.yaml",
        "/report.html/../params.yaml",
        "//params.yaml",
        "/films/../../params.yaml",
        "/films/%2e%2e%2f%2e%2e%2fparams.yaml",
        "/films/..%2f..%2fparams.mp4",
        f"/films/{TESTS[0]}.parquet",
        f"/films/{TESTS[0]}/../{TESTS[0]}.mp4",
        "/campaigns/F1/random/base/0/tests.parquet",
        "report.html",
        "HTTP://[/",
    ],
)
def test_no_path_leaves_the_report(server: ReportServer, path: str) -> None:
    answer, body = ask(server, path)
    assert (answer.status, body) == (404, b"There is no such page.")


@pytest.mark.parametrize(
    ("test", "message"),
    [
        (
            "F1-random-base-0-00009",
            "has the tests F1-random-base-0-00000 to F1-random-base-0-00003, got "
            "F1-random-base-0-00009",
        ),
        (
            "F1-radom-base-0-00001",
            "study smoke has no campaign 'F1-radom-base-0'; did you mean 'F1-random-base-0'?",
        ),
        ("--help", "study smoke has no campaign '-'"),
    ],
)
def test_only_tests_of_the_study_are_filmed(
    server: ReportServer, test: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subprocess, "run", None)
    answer, body = ask(server, f"/films/{test}.mp4")
    assert answer.status == 404 and message in body.decode()


def test_a_film_that_cannot_be_made_gives_the_reason(
    server: ReportServer, study: StudyFolder
) -> None:
    (study / "models/base/model.onnx").rename(study / "away")
    answer, body = ask(server, f"/films/{TESTS[0]}.mp4")
    (study / "away").rename(study / "models/base/model.onnx")
    assert answer.status == 404 and body.startswith(
        b"data/smoke/models/base/model.onnx: expected a readable file"
    )


def test_films_are_made_one_at_a_time_and_only_for_those_who_wait(
    films: FilmsOnDemand, monkeypatch: pytest.MonkeyPatch
) -> None:
    films_drawn: list[str] = []
    begun, end = Event(), Event()

    def slow(self: Any, test: str, new: Path) -> str:
        films_drawn.append(test)
        begun.set()
        assert end.wait(30)
        new.parent.mkdir(exist_ok=True)
        new.write_bytes(test.encode())
        return "otherwise"  # So that nothing is kept.

    monkeypatch.setattr(FilmsOnDemand, "_replay", slow)
    with ThreadPoolExecutor(3) as pool:
        first = pool.submit(films.film, TESTS[0], lambda: True)
        assert begun.wait(30)
        waiting, gone = (
            pool.submit(films.film, TESTS[2], lambda: True),
            pool.submit(films.film, TESTS[3], lambda: False),
        )
        assert gone.result(30) is None and films_drawn == TESTS[:1]
        end.set()
        results = [
            result.video.decode() for future in (first, waiting) if (result := future.result(30))
        ]
    assert results == [TESTS[0], TESTS[2]] == films_drawn


def test_a_browser_that_hangs_up_takes_its_request_back(
    server: ReportServer, films: FilmsOnDemand, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[bool] = []

    def film(test: str, wanted: Callable[[], bool]) -> None:
        asked.append(wanted())
        hung_up.wait(30)
        asked.append(wanted())

    hung_up = Event()
    monkeypatch.setattr(films, "film", film)
    connection = HTTPConnection("127.0.0.1", server.port)
    connection.request("GET", f"/films/{TESTS[0]}.mp4")
    while not asked:
        time.sleep(0.05)
    connection.close()
    hung_up.set()
    while len(asked) < 2:
        time.sleep(0.05)
    assert asked == [True, False]


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["explore", *words]) == 2
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    return printed.removeprefix("blindspot explore: ").strip()


def test_a_taken_port_is_named(server: ReportServer, capsys: pytest.CaptureFixture[str]) -> None:
    printed = refused(["--port", str(server.port)], capsys)
    assert (
        printed
        == f"--port: {server.port} is taken; choose another one, as in --port {server.port + 1}"
    )


@pytest.mark.parametrize("port", ["65536", "-1"])
def test_an_impossible_port_is_named(
    study: StudyFolder, port: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(["--port", port], capsys) == f"--port must be in [0, 65535], got {port}"


def test_another_study_is_named(study: StudyFolder, capsys: pytest.CaptureFixture[str]) -> None:
    assert refused(["thesis"], capsys).startswith(
        "params.yaml holds study smoke, expected thesis; type: python -m pipeline compose "
        "study=thesis"
    )


def test_an_unfinished_study_and_a_page_of_another_version_are_named(
    study: StudyFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    page = study / "report.html"
    text = page.read_text()
    page.write_text(text.replace("media-src", "object-src"))
    assert refused([], capsys).startswith(
        "data/smoke/report.html: expected a page made by this version of the program"
    )
    page.unlink()
    assert refused([], capsys).startswith(
        "data/smoke/report.html: no such file, so study smoke is not finished; finish it first"
    )
    page.write_text(text)


def test_a_study_without_a_report_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with chdir(StudyFolder.composed(tmp_path, "base").root):
        assert (
            refused([], capsys)
            == "study base has no report of tests; it makes data/base/models/base/model.json"
        )
