"""The generated files in the repository match the code and conf/."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.config.composing import PARAMS, compose, load
from tools import reference

ROOT = Path(__file__).resolve().parents[2]


def test_params_match_the_command_in_their_first_line() -> None:
    command = PARAMS.read_text().splitlines()[0].split("`")[1]
    study, *overrides = command.partition(" compose study=")[2].split()
    assert load(PARAMS) == compose(study, overrides), (
        f"conf/ has changed since; compose again: {command}"
    )


def test_the_reference_is_up_to_date() -> None:
    stale = [
        name
        for name, page in reference.PAGES.items()
        if (ROOT / reference.FOLDER / name).read_text() != page()
    ]
    assert not stale, "make docs/reference again: python tools/reference.py"


def test_a_stale_page_is_named_and_made_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        reference.main(["--out", str(tmp_path)]) == 0
        and reference.main(["--out", str(tmp_path), "--check"]) == 0
    )
    (tmp_path / "columns.md").write_text("older")
    assert reference.main(["--out", str(tmp_path), "--check"]) == 1
    assert f"{tmp_path / 'columns.md'}: out of date" in capsys.readouterr().err
    assert (tmp_path / "columns.md").read_text() == "older"


def test_a_page_that_cannot_be_written_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "file"
    page.touch()
    assert reference.main(["--out", str(page)]) == 2
    message = f"{page}: expected a folder to write in, got a file"
    assert capsys.readouterr().err.startswith(message)
