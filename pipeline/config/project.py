"""The project's folder, with params.yaml, data/ and models/; commands find it from any folder."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
"""The project of an editable installation."""
_typed_in = Path()
"""The folder in which a person typed the command, seen from the working directory."""


def project_of(here: Path) -> Path:
    """The nearest project at or above a folder.

    Without one, the checkout that this package is imported from; without that, the folder itself.
    """
    return next(filter(is_project, (here, *here.parents, CHECKOUT)), here)


def is_project(folder: Path) -> bool:
    """Whether a folder is a checkout, or has a params.yaml.

    data/<study>/params.yaml belongs to the project around it.
    """
    checkout = (folder / "Snakefile").is_file() and (folder / "pipeline").is_dir()
    return checkout or ((folder / "params.yaml").is_file() and folder.parent.name != "data")


@contextmanager
def entered() -> Iterator[None]:
    """Work in the project's folder; print it if it is not around the person's folder."""
    global _typed_in
    here = Path.cwd()
    folder = project_of(here)
    if folder == here:
        yield
        return
    if folder not in here.parents:
        print(f"blindspot: no project in {here} or above; using {folder}", file=sys.stderr)
    _typed_in = here
    try:
        with chdir(folder):
            yield
    finally:
        _typed_in = Path()


def typed(text: str) -> Path:
    """A path as a person typed it: relative to the folder in which they did."""
    return _typed_in / text
