"""Measure how the code and the pages read; the limits are the project's own, and a test holds them.

Usage: python tools/measure_code.py [PATH ...]   (default: pipeline; the words are always those of docs)
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
VAGUE_NAMES = frozenset({"found", "one", "own", "known", "said", "told", "made"})
LONGEST_LINE = 100


def python_files(paths: list[Path]) -> list[Path]:
    """The Python files at or below the paths, sorted."""
    files: list[Path] = []
    for path in paths:
        files += [path] if path.is_file() else path.rglob("*.py")
    return sorted(files)


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """All functions and methods of a module, nested ones included."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield node


def nested_comprehensions(tree: ast.AST) -> list[int]:
    """Line numbers of comprehensions that contain another comprehension."""
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, COMPREHENSIONS):
            inner = (child for child in ast.walk(node) if child is not node)
            if any(isinstance(child, COMPREHENSIONS) for child in inner):
                lines.append(node.lineno)
    return lines


def nested_conditionals(tree: ast.AST) -> list[int]:
    """Line numbers of conditional expressions that contain another conditional expression."""
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.IfExp):
            inner = (child for child in ast.walk(node) if child is not node)
            if any(isinstance(child, ast.IfExp) for child in inner):
                lines.append(node.lineno)
    return lines


def value_names(tree: ast.AST) -> list[tuple[str, int]]:
    """Every assigned name and every parameter, with its line number."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.append((node.id, node.lineno))
        if isinstance(node, ast.arg) and node.arg not in ("self", "cls"):
            names.append((node.arg, node.lineno))
    return names


def private_called_once(tree: ast.AST) -> list[tuple[str, int]]:
    """Private functions of a module that the module mentions exactly once, with line numbers."""
    mentions: Counter[str] = Counter()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            mentions[node.id] += 1
        elif isinstance(node, ast.Attribute):
            mentions[node.attr] += 1
    private = []
    for function in functions(tree):
        name = function.name
        if name.startswith("_") and not name.startswith("__") and mentions[name] == 1:
            private.append((name, function.lineno))
    return private


def words(path: Path) -> int:
    """Number of words in a Markdown file, tables and code included."""
    return len(path.read_text(encoding="utf-8").split())


def main(arguments: list[str]) -> int:
    """Print each place to look at, then the totals."""
    totals: Counter[str] = Counter()
    for path in python_files([Path(word) for word in arguments] or [ROOT / "pipeline"]):
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        totals["functions"] += len(list(functions(tree)))
        totals["lines"] += sum(bool(line.strip()) for line in text.splitlines())
        totals["values"] += len(value_names(tree))
        places = [
            (line, "a comprehension in a comprehension") for line in nested_comprehensions(tree)
        ]
        totals["nested comprehensions"] += len(places)
        for line in nested_conditionals(tree):
            totals["nested conditional expressions"] += 1
            places.append((line, "a conditional expression in a conditional expression"))
        for name, line in value_names(tree):
            if name in VAGUE_NAMES:
                totals["vague names"] += 1
                places.append((line, f"a value called {name}"))
        for name, line in private_called_once(tree):
            totals["private functions called once"] += 1
            places.append((line, f"{name} is private and called once"))
        for number, line_text in enumerate(text.splitlines(), 1):
            if len(line_text) > LONGEST_LINE:
                totals["lines over 100 columns"] += 1
                places.append((number, f"{len(line_text)} columns"))
        for line, message in sorted(places):
            print(f"{path}:{line}: {message}")
    for name, count in totals.items():
        print(f"{name}: {count}")
    print(f"words in docs: {sum(words(page) for page in (ROOT / 'docs').rglob('*.md'))}")
    print(f"lines in dvc.yaml: {len((ROOT / 'dvc.yaml').read_text().splitlines())}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
