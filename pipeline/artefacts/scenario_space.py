"""data/<study>/space/<scenario>.json: the logical scenario space that every later step reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.artefacts.files import read_json, write_json
from pipeline.core.space import Space
from pipeline.core.worlds import Worlds
from pipeline.errors import InputError

FORMAT = 1


@dataclass(frozen=True)
class ScenarioInfo:
    """The functional scenario of a space.

    Attributes:
        pairs: feasible pairs of categories, which pair coverage counts.
        town, people: fingerprints of its town and of its population, empty if it has none.
        asks_to_brake: whether a pedestrian crosses the ego's path.
    """

    name: str
    label: str
    description: str
    pairs: int
    town: str = ""
    people: str = ""
    asks_to_brake: bool = field(default=True, kw_only=True)

    @property
    def worlds(self) -> Worlds:
        """Its town and its people."""
        return Worlds.of(self.town, self.people)


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
            "people": info.people,
            "asks_to_brake": info.asks_to_brake,
            "sizes": dict(zip(space.names, space.sizes, strict=True)),
            **plain_space(space),
        },
    )


def plain_space(space: Space) -> dict[str, Any]:
    """The variables and the constraints of a space as plain data; `space_of` reads them back."""
    return {
        "variables": space.to_dict(),
        **({"constraints": list(space.clauses)} if space.clauses else {}),
    }


def space_of(described: Mapping[str, Any]) -> Space:
    """The space of plain data as from `plain_space`.

    Other data raises KeyError, TypeError, ValueError or AttributeError.
    """
    return Space.from_dict(described["variables"], described.get("constraints", ()))


def read_space(path: Path) -> tuple[ScenarioInfo, Space]:
    """Read a space; InputError that names the file if it is missing, truncated or not a space."""
    plain = read_json(path)
    try:
        if plain["format"] != FORMAT:
            raise ValueError(f"format must be {FORMAT}, got {plain['format']!r}")
        named = (
            plain[key] for key in ("scenario", "label", "description", "pairs", "town", "people")
        )
        return ScenarioInfo(*named, asks_to_brake=plain["asks_to_brake"]), space_of(plain)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{path}: expected a scenario space, got {error!r}; make it again with define-space"
        ) from error


def read_spaces(paths: Iterable[Path]) -> dict[str, tuple[ScenarioInfo, Space]]:
    """Read several spaces, by the name of the scenario, in the given order."""
    return {info.name: (info, space) for info, space in map(read_space, paths)}
