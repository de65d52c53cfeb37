"""The code and the pages keep the limits of tools/measure_code.py, which counts what it should."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import pytest

from tools import measure_code

SAMPLE = """
def _once(rows):
    found = [cell for row in rows for cell in (value for value in row)]
    return 1 if found else 2 if rows else 3


def public(rows):
    return _once(rows)
"""


def test_the_limits_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    assert measure_code.main([]) == 0, capsys.readouterr().out.splitlines()[-1]


def test_what_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "sample.py"
    path.write_text(SAMPLE + "# " + "x" * 99 + "\n")
    totals: Counter[str] = Counter()
    places = measure_code.code_figures(path, totals)
    assert [message for _, message in places] == [
        "_once is private and called once",
        "a comprehension in a comprehension",
        "a value called found",
        "a conditional expression in a conditional expression",
        "101 columns",
    ]
    assert (totals["functions"], totals["values"], totals["lines"]) == (2, 6, 6)
    assert measure_code.value_names(ast.parse("for x in y: pass")) == [("x", 1)]


def test_a_figure_over_its_limit_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sample.py").write_text(SAMPLE)
    monkeypatch.setitem(measure_code.LIMITS, "functions", 1)
    assert measure_code.main([str(tmp_path)]) == 1
    assert "functions: 2 (limit 1)" in capsys.readouterr().out
