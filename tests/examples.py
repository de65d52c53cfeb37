"""Runs the examples in a module's docstrings."""

from __future__ import annotations

import doctest
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def modules_with_examples(*rooms: str) -> list[str]:
    """The dotted names of the modules in folders of the checkout whose text has examples."""
    modules = []
    for room in rooms:
        for path in sorted((ROOT / room).rglob("*.py")):
            if ">>> " in path.read_text(encoding="utf-8"):
                modules.append(".".join(path.relative_to(ROOT).with_suffix("").parts))
    return modules


def run_examples(module: str) -> doctest.TestResults:
    """Run a module's examples, as `python -m doctest` does."""
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    return doctest.testmod(import_module(module), optionflags=options)
