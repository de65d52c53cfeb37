"""Published numbers follow from published outcomes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tools.results import blocks, main, published

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = (
    "import sys; rows = open(sys.argv[1]).read().split(); print(f'| failures |\\n|---|\\n| "
    "{sum(map(int, rows))} |')"
)


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").touch()
    (tmp_path / "count.py").write_text(SCRIPT)
    (tmp_path / "outcomes.csv").write_text("1\n0\n1\n")
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text("# No numbers\n")
    page = tmp_path / "docs" / "found.md"
    page.write_text(
        "# Found\n\n<!-- made by: python count.py outcomes.csv -->\nold\n<!-- end -->\n\nText "
        "after it.\n"
    )
    assert main(["write"]) == 0
    return page


def test_written_pages_pass(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert page.read_text().endswith(
        "-->\n\n| failures |\n|---|\n| 2 |\n\n<!-- end -->\n\nText after it.\n"
    )
    assert [(block.command, block.line) for block in blocks(page)] == [
        ("python count.py outcomes.csv", 3)
    ]
    assert main(["verify"]) == 0
    assert capsys.readouterr().out == "1 page checked: every number follows from the outcomes\n"
    before = page.read_bytes()
    assert main(["write"]) == 0 and page.read_bytes() == before


def test_a_changed_number_is_found(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page.write_text(page.read_text().replace("| 2 |", "| 3 |"))
    assert main(["verify"]) == 1
    difference = (
        "docs/found.md, line 3: expected what `python count.py outcomes.csv` prints, got "
        "another text\n"
    )
    assert capsys.readouterr().out == f"{difference}  page    | 3 |\n  command | 2 |\n"


def test_a_changed_outcome_is_found(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("outcomes.csv").write_text("1\n1\n1\n")
    assert main(["verify", str(page)]) == 1
    assert "page    | 2 |\n  command | 3 |" in capsys.readouterr().out


@pytest.mark.parametrize("mark", ["<!-- End -->", "<!-- end-->", ""])
def test_a_block_without_its_end_is_found(
    page: Path, mark: str, capsys: pytest.CaptureFixture[str]
) -> None:
    page.write_text(page.read_text().replace("| 2 |", "| 3 |").replace("<!-- end -->", mark))
    assert main(["verify"]) == 2
    assert "docs/found.md: expected blocks from" in capsys.readouterr().err


def test_a_named_page_without_blocks_is_refused(
    page: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", "README.md"]) == 2
    assert "got 0 begun and 0 whole" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("rm -r docs", "begin with 'python'"),
        ("''", "begin with 'python'"),
        ("python none.py", "`python none.py` ended with 2: "),
        ("python silent.py", "`python silent.py` ended with 3\n"),
        (
            'python -c "print(1)',
            "must be one that a shell reads, got 'python -c \"print(1)': No closing quotation",
        ),
    ],
)
def test_a_command_that_does_not_work_is_named(
    page: Path, command: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    page.write_text(f"<!-- made by: {command} -->\n<!-- end -->\n")
    Path("silent.py").write_text("raise SystemExit(3)")
    assert main(["verify"]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("action", ["verify", "write"])
@pytest.mark.parametrize(
    ("name", "message"), [("nope.md", "No such file"), (".", "Is a directory")]
)
def test_a_page_that_cannot_be_read_is_named(
    page: Path, action: str, name: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([action, name]) == 2
    assert f"{name}: expected a readable page, got {message}" in capsys.readouterr().err


def test_the_pages_of_the_repository_have_blocks() -> None:
    names = {page.name for page in published(ROOT)}
    assert {"README.md", "strategies.md"} <= names


def test_a_changed_number_in_the_readme_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    copy, text = tmp_path / "README.md", Path("README.md").read_text()
    changed = re.sub(r"\d+(?=\s+of\s+\d+\s+held-out)", lambda number: str(int(number[0]) + 1), text)
    assert changed != text
    copy.write_text(changed)
    assert main(["verify", str(copy)]) == 1
    expected = "expected what `python -m benchmarks.default_study headline` prints"
    assert expected in capsys.readouterr().out
