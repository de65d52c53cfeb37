"""Finds the source files that a module of this package depends on, by its imports."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import grimp

ROOT = Path(__file__).resolve().parents[1]


@cache
def _graph() -> grimp.ImportGraph:
    return grimp.build_graph("pipeline", cache_dir=".cache/grimp")


@cache
def sources(module: str) -> tuple[str, ...]:
    """Source files of a module and of everything that it imports from this package, directly or not, relative to the root; sorted.

    Templates count as source of the modules beside them.
    """
    graph = _graph()
    found = set()
    for name in {module} | graph.find_upstream_modules(module):
        stem = ROOT.joinpath(*name.split("."))
        path = stem.with_suffix(".py") if stem.with_suffix(".py").exists() else stem / "__init__.py"
        if path.stat().st_size:
            found |= {file.relative_to(ROOT).as_posix() for file in (path, *path.parent.glob("*.jinja"))}
    return tuple(sorted(found))


@cache
def code_digest(module: str) -> str:
    """SHA-256 over `sources` of a module."""
    digest = hashlib.sha256()
    for path in sources(module):
        digest.update(path.encode() + (ROOT / path).read_bytes())
    return digest.hexdigest()


@cache
def source_digests(module: str) -> dict[str, str]:
    """SHA-256 of each file of `sources` of a module."""
    return {path: hashlib.sha256((ROOT / path).read_bytes()).hexdigest() for path in sources(module)}
