"""Reads and writes whole files: atomic writes, equal bytes for equal content, and errors that name the file."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from pipeline.errors import InputError


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file atomically: readers see the old or the new file, never a part, even after a kill; creates its folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, plain: Any) -> None:
    """Write plain data as indented JSON in the given order; ValueError for NaN and infinities, which JSON lacks."""
    write_bytes(path, (json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())


def read_bytes(path: Path) -> bytes:
    """Read a whole file; InputError if it is missing or unreadable."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: expected a readable file, got {error.strerror or error}; make it with snakemake") from error


def read_json(path: Path) -> Any:
    """Read JSON; InputError if the file is missing, truncated or not JSON."""
    text = read_bytes(path)
    try:
        return json.loads(text)
    except ValueError as error:
        raise InputError(f"{path}: expected JSON, got a truncated or foreign file ({error}); make it again") from error


def program_sha256() -> str:
    """Hexadecimal SHA-256 of this package's source: intermediate results of another code version are ignored."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(Path(__file__).parents[1].rglob("*.py")))).hexdigest()


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes, or of a folder's files by name and content; InputError if it is missing."""
    if not path.is_dir():
        return hashlib.sha256(read_bytes(path)).hexdigest()
    files = sorted(file for file in path.rglob("*") if file.is_file())
    named = "".join(f"{file.relative_to(path).as_posix()} {sha256(file)}\n" for file in files)
    return hashlib.sha256(named.encode()).hexdigest()
