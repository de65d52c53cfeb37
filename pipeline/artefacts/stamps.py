"""Stamps: the file beside a job's first output that says what the outputs depend on, and lists the
digest of each.

Line 1 is the stamp proper, the last line the digest of the lines above it; the lines between are
those of `sha256sum`. A damaged stamp counts as none.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from pipeline.errors import InputError

SUFFIX = ".stamp"
LEVELS = 3
"""A file's digest is in a stamp of its own folder or of the two above it: a data set's images lie
two below their stamp."""


@dataclass(frozen=True)
class Stamp:
    """A stamp. digests: of the job's files, by their paths relative to the stamp's folder."""

    depends: str
    digests: Mapping[str, str] = field(default_factory=dict)

    def text(self) -> str:
        lines = f"{self.depends}\n"
        for name, digest in sorted(self.digests.items()):
            lines += f"{digest}  {name}\n"
        return f"{lines}{hashlib.sha256(lines.encode()).hexdigest()}\n"


def made(path: Path, depends: str, outputs: Iterable[Path]) -> Stamp:
    """The stamp, to be written at `path`, of outputs that are there.

    Outputs are files, or folders with all files in them.
    """
    digests = {}
    for output in outputs:
        for file in output.rglob("*") if output.is_dir() else [output]:
            if file.is_file():
                digests[file.relative_to(path.parent).as_posix()] = digest(file)
    _listed.cache_clear()
    return Stamp(depends, digests)


def read(path: Path) -> Stamp | None:
    """The stamp in a file; None if there is none or it is damaged."""
    try:
        text = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError):
        return None
    first, *listed = text.splitlines()[:-1] or [""]
    digests = {}
    for line in listed:
        value, _, name = line.partition("  ")
        digests[name] = value
    stamp = Stamp(first, digests)
    return stamp if stamp.text() == text else None


def withdraw(path: Path) -> None:
    """Remove a stamp, so that Snakemake makes its job's files again and nothing compares them with
    it.
    """
    remove(path)
    _listed.cache_clear()


def remove(path: Path) -> None:
    """Remove a file, a folder or nothing."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def check(path: Path, data: bytes) -> None:
    """Compare a file's bytes with the digest that a stamp lists for it, if one does.

    Raises:
        InputError: if they differ.
    """
    absolute = path.absolute()
    for folder in absolute.parents[:LEVELS]:
        listed = _listed(folder, folder.stat().st_mtime_ns)
        name = absolute.relative_to(folder).as_posix()
        if name not in listed:
            continue
        expected, stamp = listed[name]
        if hashlib.sha256(data).hexdigest() == expected:
            return
        if stamp.is_relative_to(Path.cwd()):
            stamp = stamp.relative_to(Path.cwd())
        raise InputError(
            f"{path}: damaged or edited, its SHA-256 is not the one in {stamp}; make it again (in "
            "a study, ./run does)"
        )


def damaged(root: Path) -> Iterator[tuple[Path, Path]]:
    """The damaged files below a folder, each with its stamp; a damaged stamp comes with itself.

    Deleted files are not damaged, except those inside a folder that is still there: Snakemake sees
    only the folder.
    """
    for path in sorted(root.rglob(f"*{SUFFIX}")):
        stamp = read(path)
        if stamp is None:
            yield path, path
        for name, expected in (stamp.digests if stamp else {}).items():
            file = path.parent / name
            inside = file.parent != path.parent and file.parent.is_dir()
            wrong = file.is_dir() or (inside if not file.exists() else digest(file) != expected)
            if wrong and read(path) == stamp:  # A job beside this command may have made both anew.
                yield file, path


def digest(file: Path) -> str:
    """Hexadecimal SHA-256 of a file, read piece by piece."""
    with file.open("rb") as data:
        return hashlib.file_digest(data, "sha256").hexdigest()


@lru_cache(maxsize=256)
def _listed(folder: Path, changed_ns: int) -> Mapping[str, tuple[str, Path]]:
    """All digests that the stamps in a folder list.

    Args:
        changed_ns: of the folder, as a key: every written stamp changes it.
    """
    listed = {}
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        stamp = read(path)
        for name, value in stamp.digests.items() if stamp else ():
            listed[name] = (value, path)
    return listed
