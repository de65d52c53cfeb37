"""data/<study>/space/<scenario>.json: the logical scenario space that every later step reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.artefacts.files import read_json, write_json
from pipeline.core.space import Space
from pipeline.errors import InputError

FORMAT = 1


@dataclass(frozen=True)
class ScenarioInfo:
    """The functional scenario of a space. pairs: feasible pairs of categories, which pair coverage counts.

    town: its fingerprint.
    """

    name: str
    label: str
    description: str
    pairs: int
    town: str = ""


def write_space(path: Path, info: ScenarioInfo, space: Space) -> None:
    """Write the space of one functional scenario."""
    write_json(
        path,
        {
            "format": FORMAT,
            "scenario": info.name,
            "label": info.label,
            "description": info.description,
            "pairs": info.pairs,
            "town": info.town,
            "sizes": dict(zip(space.names, space.sizes, strict=True)),
            "variables": space.to_dict(),
            **({"constraints": [list(clause) for clause in space.clauses]} if space.clauses else {}),
        },
    )


def read_space(path: Path) -> tuple[ScenarioInfo, Space]:
    """Read a space; InputError that names the file if it is missing, truncated or not a space."""
    plain = read_json(path)
    try:
        if plain["format"] != FORMAT:
            raise ValueError(f"format must be {FORMAT}, got {plain['format']!r}")
        info = ScenarioInfo(plain["scenario"], plain["label"], plain["description"], plain["pairs"], plain["town"])
        return info, Space.from_dict(plain["variables"], plain.get("constraints", ()))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: expected a scenario space, got {error!r}; make it again with define-space") from error
