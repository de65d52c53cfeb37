"""Tests import helpers, never each other."""

from __future__ import annotations

import ast
import re

import pytest

from tests.studies import ROOT

SOURCES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path.read_text()
    for path in sorted((ROOT / "tests").rglob("*.py"))
}
"""The source of each module of the tests, by dotted name."""
DOTTED = re.compile(r"\btests(?:\.\w+)+")


def imports(module: str, source: str) -> set[str]:
    """The dotted names that a module imports at any depth, or that its texts contain.

    Texts count because subprocesses and configs import what they name.
    """
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            package = module.split(".")[: -node.level] if node.level else []
            base = ".".join([*package, node.module or ""]).strip(".")
            names.update({base, *(f"{base}.{alias.name}" for alias in node.names)})
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names.update(DOTTED.findall(node.value))
    return names


def imported_tests(module: str, source: str, modules: list[str]) -> list[str]:
    """Each import of another test module, as 'importer imports imported'."""
    pairs = []
    names = imports(module, source)
    for other in modules:
        inside = any(name == other or name.startswith(f"{other}.") for name in names)
        if inside and other != module and other.split(".")[-1].startswith("test_"):
            pairs.append(f"{module} imports {other}")
    return pairs


def test_no_module_imports_a_test_module() -> None:
    pairs = []
    for module, source in SOURCES.items():
        pairs += imported_tests(module, source, list(SOURCES))
    assert not pairs, "move what they share into a helper or a conftest.py"


@pytest.mark.parametrize(
    "source",
    [
        "from tests.room.test_other import value",
        "from tests.room import test_other",
        "from .test_other import value",
        "from . import test_other",
        "from ..room.test_other import value",
        "import tests.room.test_other as other",
        "def late():\n    from tests.room.test_other import value",
        "PROGRAM = 'from tests.room.test_other import value'",
        "TARGET = 'simulator._target_=tests.room.test_other.Slow'",
    ],
)
def test_each_way_to_import_a_test_module_is_reported(source: str) -> None:
    modules = ["tests.room.test_this", "tests.room.test_other", "tests.room.helpers"]
    assert imported_tests("tests.room.test_this", source, modules) == [
        "tests.room.test_this imports tests.room.test_other"
    ]


@pytest.mark.parametrize(
    "source",
    [
        "from tests.room.helpers import value",
        "from pipeline.commands import test_other",
        "from tests.room.test_others import value",
        "TARGET = 'tests.room.test_this.Slow'",
    ],
)
def test_helpers_and_other_packages_may_be_imported(source: str) -> None:
    modules = ["tests.room.test_this", "tests.room.test_other", "tests.room.helpers"]
    assert imported_tests("tests.room.test_this", source, modules) == []
