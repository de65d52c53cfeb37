"""Measure how the code and the pages read; a test holds the limits.

Usage: python tools/measure_code.py [PATH ...]   (default: pipeline; pages are always measured)
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
LIMITS = {
    "functions": 2_270,
    "nested comprehensions per 1,000 lines": 1.0,
    "vague names, % of values": 0.5,
    "lines over 100 columns": 0,
    "lines in dvc.yaml": 150,
    "lines in benchmarks": 4_000,
    "words in docs": 35_000,
    "words in docs/results": 8_000,
    "words in CHANGELOG.md": 1_500,
}
"""The most that a whole measurement may find."""


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


def code_figures(path: Path, totals: Counter[str]) -> list[tuple[int, str]]:
    """Add the counts of a file to `totals`; return the places to look at, by line number."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    places = []
    for line in nested_comprehensions(tree):
        totals["nested comprehensions"] += 1
        places.append((line, "a comprehension in a comprehension"))
    for line in nested_conditionals(tree):
        totals["nested conditional expressions"] += 1
        places.append((line, "a conditional expression in a conditional expression"))
    for name, line in value_names(tree):
        totals["values"] += 1
        if name in VAGUE_NAMES:
            totals["vague names"] += 1
            places.append((line, f"a value called {name}"))
    for name, line in private_called_once(tree):
        totals["private functions called once"] += 1
        places.append((line, f"{name} is private and called once"))
    for line, text_of_line in enumerate(text.splitlines(), 1):
        totals["lines"] += bool(text_of_line.strip())
        if len(text_of_line) > LONGEST_LINE:
            totals["lines over 100 columns"] += 1
            places.append((line, f"{len(text_of_line)} columns"))
    totals["functions"] += len(list(functions(tree)))
    return sorted(places)


def page_figures() -> dict[str, int]:
    """Lines of dvc.yaml and of the benchmarks, words of the pages."""
    benchmarks = python_files([ROOT / "benchmarks"])
    return {
        "lines in dvc.yaml": line_count([ROOT / "dvc.yaml"]),
        "lines in benchmarks": line_count(benchmarks),
        "words in docs": sum(words(page) for page in (ROOT / "docs").rglob("*.md")),
        "words in docs/results": sum(words(page) for page in (ROOT / "docs/results").glob("*.md")),
        "words in CHANGELOG.md": words(ROOT / "CHANGELOG.md"),
    }


def line_count(paths: list[Path]) -> int:
    """Number of lines in files."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def measure(paths: list[Path]) -> dict[str, float]:
    """Print each place to look at; return the figures by name."""
    totals: Counter[str] = Counter()
    for path in python_files(paths):
        for line, message in code_figures(path, totals):
            print(f"{path}:{line}: {message}")
    nested = 1000 * totals["nested comprehensions"] / totals["lines"]
    vague = 100 * totals["vague names"] / totals["values"]
    return {
        "functions": totals["functions"],
        "private functions called once": totals["private functions called once"],
        "nested conditional expressions": totals["nested conditional expressions"],
        "lines over 100 columns": totals["lines over 100 columns"],
        "nested comprehensions per 1,000 lines": nested,
        "vague names, % of values": vague,
        **page_figures(),
    }


def main(arguments: list[str]) -> int:
    """Print all figures; exit code 1 if a figure is over its limit."""
    figures = measure([Path(word) for word in arguments] or [ROOT / "pipeline"])
    over = []
    for name, figure in figures.items():
        limit = LIMITS.get(name)
        print(f"{name}: {figure:.4g}" + ("" if limit is None else f" (limit {limit:g})"))
        if limit is not None and figure > limit:
            over.append(name)
    if over:
        print(f"over the limit: {', '.join(over)}")
    return int(bool(over))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
