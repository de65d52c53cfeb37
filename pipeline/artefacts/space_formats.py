"""Spaces in any of the formats that are read.

These are our space files, PICT and ACTS models, and OpenODD files.
"""

from __future__ import annotations

from pathlib import Path

from pipeline.artefacts.acts_model import HEADER, read_acts_model
from pipeline.artefacts.odd_file import BEGINS, read_odd_file
from pipeline.artefacts.pict_model import read_pict_model
from pipeline.artefacts.space_file import read_space_file
from pipeline.artefacts.statements import read_text
from pipeline.core.space import Space


def read_space_of_any_format(path: Path) -> Space:
    """Read a space: `.xml` is an ACTS model, `.txt` an ACTS model if it begins with [System] and
    else a PICT model, the rest is YAML: an OpenODD file if it has a section of one, else a space
    file.

    Raises:
        InputError: naming the file, the place and what was expected.
    """
    suffix = path.suffix.lower()
    if suffix == ".xml":
        return read_acts_model(path)
    if suffix == ".txt":
        lines = read_text(path, "a PICT or ACTS model").splitlines()
        text = "\n".join(line for line in lines if not line.lstrip().startswith("--"))
        return read_acts_model(path) if HEADER.match(text) else read_pict_model(path)
    if path.is_file() and BEGINS.search(path.read_bytes()):
        return read_odd_file(path)
    return read_space_file(path)
