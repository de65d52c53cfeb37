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
from pipeline.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
STORED = Path(f".cache/digests-{hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:12]}.json")
"""Digests of code by those of files, for as long as this file finds them in the same way."""
BESIDE = ("*.jinja", "assets/*.js", "assets/*.css")
BEGINS = (tokenize.ENCODING, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
"""The tokens after which a statement begins."""


@cache
def _graph() -> grimp.ImportGraph:
    graph = grimp.build_graph("pipeline", cache_dir=".cache/grimp")
    for name in graph.modules - {"pipeline"}:  # Importing a module runs the packages above it.
        graph.add_import(importer=name, imported=name.rpartition(".")[0])
    return graph


@cache
def sources(module: str) -> tuple[str, ...]:
    """Source files of a module and of everything that it imports from this package.

    Templates, and the scripts and styles in a folder `assets`, count as source of the modules
    beside them.

    Args:
        module: dotted name of the module.

    Returns:
        Paths relative to the root, sorted. Indirect imports count, empty files do not.
    """
    modules = {module} | _graph().find_upstream_modules(module)
    return tuple(sorted(set().union(*map(_files, modules))))


@cache
def _files(module: str) -> frozenset[str]:
    """The source files of a single module; none if it is empty."""
    stem = ROOT.joinpath(*module.split("."))
    path = stem.with_suffix(".py") if stem.with_suffix(".py").exists() else stem / "__init__.py"
    if not path.stat().st_size:
        return frozenset()
    beside = (file for pattern in BESIDE for file in path.parent.glob(pattern))
    return frozenset(file.relative_to(ROOT).as_posix() for file in (path, *beside))


@cache
def code_digest(module: str) -> str:
    """SHA-256 over `sources` of a module, without their comments and docstrings."""
    return hashlib.sha256(
        "".join(path + digest for path, digest in source_digests(module).items()).encode()
    ).hexdigest()


@cache
def source_digests(module: str) -> dict[str, str]:
    """SHA-256 of each file of `sources` of a module, without its comments and docstrings."""
    stored = stored_digests()
    texts = {path: (ROOT / path).read_bytes() for path in sources(module)}
    raw = {path: hashlib.sha256(text).hexdigest() for path, text in texts.items()}
    new = {path: digest for path, digest in raw.items() if digest not in stored}
    for path, digest in new.items():
        stored[digest] = hashlib.sha256(code_of(path, texts[path])).hexdigest()
    if new:
        with suppress(OSError, InputError):
            write_bytes(STORED, json.dumps(stored).encode(), flush=False)
    return {path: stored[digest] for path, digest in raw.items()}


@cache
def stored_digests() -> dict[str, str]:
    """Digests of the code alone by those of the whole files.

    They are stored because removing the comments and docstrings of all files takes a second.
    """
    try:
        return dict(json.loads(STORED.read_bytes()))
    except (OSError, ValueError):
        return {}


def code_of(path: str, text: bytes) -> bytes:
    """A file without Python's comments and docstrings, nor the lines that hold nothing else."""
    if not path.endswith(".py"):
        return text
    # As bytes: Python's lines end at line feeds alone, but those of a text also at form feeds and
    # other signs.
    lines: list[str | None] = [line.decode() for line in text.splitlines(keepends=True)]
    tokens = [
        token for token in tokenize.tokenize(io.BytesIO(text).readline) if token.type != tokenize.NL
    ]
    for token in tokens:
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = f"{before}\n" if (before := token.line[:column].rstrip()) else None
    code = [token for token in tokens if token.type != tokenize.COMMENT]
    for previous, token, following in zip(code, code[1:], code[2:], strict=False):
        # A docstring: a string that is a whole statement.
        if (
            token.type == tokenize.STRING
            and previous.type in BEGINS
            and following.type == tokenize.NEWLINE
        ):
            first, last = token.start[0] - 1, token.end[0]
            lines[first:last] = [None] * (last - first)
    return "".join(line for line in lines if line is not None).encode()
