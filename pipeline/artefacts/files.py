"""Reads and writes whole files; every artefact passes through `write_bytes` and `read_bytes`.

Writes are atomic and durable, reads are checked against stamps, errors name the file.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import tempfile
from collections.abc import Iterable
from glob import escape
from pathlib import Path
from typing import Any

from pipeline.artefacts import stamps
from pipeline.errors import InputError

DIGEST = 65
"""Bytes of the line with the digest at the end of a sealed file."""


def write_bytes(path: Path, data: bytes, *, flush: bool = True) -> None:
    """Write a file atomically, and its folders if they are missing.

    Readers see the old or the new file, never a part, even after a kill or a power cut.

    Args:
        path: the file.
        data: its content.
        flush: whether the file is on the disk when this returns. A caller that writes many files
            flushes them together, with `os.sync`.
    """
    make_folder(path.parent)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            if flush:
                file.flush()
                os.fsync(file.fileno())
        os.replace(temporary, path)
    except IsADirectoryError as error:
        raise InputError(
            f"{path}: expected a file or nothing, got a folder; move it away"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)
    if flush:
        # Put the names in the folder on the disk, where its file system can.
        opened = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(opened)
        except OSError as error:
            if error.errno != errno.EINVAL:
                raise
        finally:
            os.close(opened)


def make_folder(folder: Path) -> None:
    """Make a folder and those above it.

    Raises:
        InputError: naming the file, or the link to nothing, that is in the way.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        there = next(path for path in (folder, *folder.parents) if os.path.lexists(path))
        got = (
            f"a link to {os.readlink(there)}, which is missing"
            if there.is_symlink() and not there.exists()
            else "a file; move it away"
        )
        raise InputError(f"{there}: expected a folder to write in, got {got}") from error


def remove_unfinished(paths: Iterable[Path]) -> None:
    """Remove what killed writers of these files left beside them; nobody may be writing them."""
    for path in paths:
        for temporary in path.parent.glob(f".{escape(path.name)}.*.tmp"):
            temporary.unlink()


def write_json(path: Path, plain: Any) -> None:
    """Write plain data as indented JSON in the given order.

    Raises:
        ValueError: for NaN and infinities, which JSON lacks.
    """
    write_bytes(
        path, (json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()
    )


def check_output(path: Path, folder: bool = False) -> None:
    """Check before the work that a file, or a folder of files, can be written.

    Raises:
        InputError: if it cannot.
    """
    wanted = "a folder" if folder else "a file"
    if path.exists() and (path.is_dir() is not folder or not (folder or path.is_file())):
        raise InputError(
            f"{path}: expected {wanted} to write to, got "
            f"{'a folder' if path.is_dir() else 'something else'}"
        )
    existing = path if folder and path.is_dir() else path.parent
    if not existing.is_dir():
        raise InputError(
            f"{path}: expected {wanted} to write to, got one in {existing}, which is not a folder"
        )
    try:
        tempfile.TemporaryFile(dir=existing).close()
    except OSError as error:
        raise InputError(f"{path}: expected {wanted} to write to, got {error.strerror}") from error


def read_bytes(path: Path) -> bytes:
    """Read a whole file.

    Raises:
        InputError: if it is missing or unreadable, or if its digest is not the one in its stamp.
    """
    data = _read(path)
    stamps.check(path, data)
    return data


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: expected a readable file, got {error.strerror or error}; ./run makes the "
            "files of a study"
        ) from error


def read_json(path: Path) -> Any:
    """Read JSON; InputError if the file is missing, damaged or not JSON."""
    text = read_bytes(path)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path}: expected JSON, got a truncated or foreign file ({error}); make it again"
        ) from error


def write_sealed(path: Path, data: bytes) -> None:
    """Write a file of an unfinished job, which no stamp lists yet.

    Its last line is its own digest.
    """
    write_bytes(path, data + f"\n{hashlib.sha256(data).hexdigest()}".encode())


def read_sealed(path: Path) -> bytes:
    """Read what `write_sealed` wrote; InputError if it is missing, unreadable or damaged."""
    # Looking for its stamp among thousands of tests would take longer than reading it.
    data = _read(path)
    content, line = data[:-DIGEST], data[-DIGEST:]
    if line != f"\n{hashlib.sha256(content).hexdigest()}".encode():
        raise InputError(
            f"{path}: damaged, its content differs from the digest at its end; delete it and run "
            "the same command again"
        )
    return content


def program_sha256(*packages: str) -> str:
    """Hexadecimal SHA-256 of this package's source, or of some packages in it.

    Intermediate results of another code version are ignored.
    """
    root = Path(__file__).parents[1]
    files = sorted({path for name in packages or ("",) for path in (root / name).rglob("*.py")})
    listed = (
        f"{path.relative_to(root)} {hashlib.sha256(path.read_bytes()).hexdigest()}\n"
        for path in files
    )
    return hashlib.sha256("".join(listed).encode()).hexdigest()


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes, or of a folder's files by name and content.

    Raises:
        InputError: if it is missing or damaged.
    """
    if not path.is_dir():
        return hashlib.sha256(read_bytes(path)).hexdigest()
    files = sorted(file for file in path.rglob("*") if file.is_file())
    named = "".join(f"{file.relative_to(path).as_posix()} {sha256(file)}\n" for file in files)
    return hashlib.sha256(named.encode()).hexdigest()
