"""Finds the source files that a module of this package depends on, by its imports."""

from __future__ import annotations

import hashlib
import io
import json
import tokenize
from contextlib import suppress
from functools import cache
from pathlib import Path

import grimp

from pipeline.artefacts.files import write_bytes

ROOT = Path(__file__).resolve().parents[1]
STORED = Path(".cache/code.json")


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
    """SHA-256 over `sources` of a module, without their comments."""
    return hashlib.sha256("".join(path + digest for path, digest in source_digests(module).items()).encode()).hexdigest()


@cache
def source_digests(module: str) -> dict[str, str]:
    """SHA-256 of each file of `sources` of a module, without its comments."""
    known = _known()
    texts = {path: (ROOT / path).read_bytes() for path in sources(module)}
    raw = {path: hashlib.sha256(text).hexdigest() for path, text in texts.items()}
    if new := {path: raw[path] for path in texts if raw[path] not in known}:
        known |= {digest: hashlib.sha256(_code(path, texts[path])).hexdigest() for path, digest in new.items()}
        with suppress(OSError):
            write_bytes(STORED, json.dumps(known).encode(), flush=False)
    return {path: known[digest] for path, digest in raw.items()}


@cache
def _known() -> dict[str, str]:
    """Digests without comments by those of the whole files: to find the comments of all files takes half a second."""
    try:
        return dict(json.loads(STORED.read_bytes()))
    except (OSError, ValueError):
        return {}


def _code(path: str, text: bytes) -> bytes:
    """A file without Python's comments, nor the lines that hold nothing else."""
    if not path.endswith(".py") or b"#" not in text:
        return text
    lines: list[str | None] = list(text.decode().splitlines(keepends=True))
    for token in tokenize.tokenize(io.BytesIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = f"{before}\n" if (before := token.line[:column].rstrip()) else None
    return "".join(line for line in lines if line is not None).encode()
