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
        lines = "".join(
            f"{line}\n"
            for line in (
                self.depends,
                *(f"{digest}  {name}" for name, digest in sorted(self.digests.items())),
            )
        )
        return f"{lines}{hashlib.sha256(lines.encode()).hexdigest()}\n"


def made(path: Path, depends: str, outputs: Iterable[Path]) -> Stamp:
    """The stamp, to be written at `path`, of outputs that are there.

    Files, or folders with all files in them.
    """
    files = [
        file
        for output in outputs
        for file in (output.rglob("*") if output.is_dir() else [output])
        if file.is_file()
    ]
    _listed.cache_clear()
    return Stamp(
        depends, {file.relative_to(path.parent).as_posix(): digest(file) for file in files}
    )


def read(path: Path) -> Stamp | None:
    """The stamp in a file; None if there is none or it is damaged."""
    try:
        text = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError):
        return None
    first, *listed = text.splitlines()[:-1] or [""]
    found = Stamp(
        first, {name: value for value, _, name in (line.partition("  ") for line in listed)}
    )
    return found if found.text() == text else None


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
    known = _known(path.absolute())
    if known is not None and hashlib.sha256(data).hexdigest() != known[0]:
        stamp = (
            known[1].relative_to(Path.cwd()) if known[1].is_relative_to(Path.cwd()) else known[1]
        )
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


def _known(path: Path) -> tuple[str, Path] | None:
    """The digest that a stamp lists for a file, and the stamp."""
    for folder in path.parents[:LEVELS]:
        found = _listed(folder, folder.stat().st_mtime_ns)
        if (name := path.relative_to(folder).as_posix()) in found:
            return found[name]
    return None


@lru_cache(maxsize=256)
def _listed(folder: Path, changed_ns: int) -> Mapping[str, tuple[str, Path]]:
    """All digests that the stamps in a folder list.

    Args:
        changed_ns: of the folder, as a key: every written stamp changes it.
    """
    stamps = {path: read(path) for path in sorted(folder.glob(f"*{SUFFIX}"))}
    return {
        name: (value, path)
        for path, stamp in stamps.items()
        if stamp
        for name, value in stamp.digests.items()
    }
