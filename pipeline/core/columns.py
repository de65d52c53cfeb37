"""A column of a table, declared once: its name, type, unit and meaning."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

Kind = type[int] | type[float] | type[bool] | type[str] | type[bytes]


@dataclass(frozen=True)
class Column:
    """A column. unit: empty if it has none. allowed: its possible texts, empty for any text."""

    name: str
    kind: Kind
    meaning: str
    unit: str = ""
    allowed: tuple[str, ...] = ()

    @property
    def nothing(self) -> Any:
        """The column's value for nothing to report: NaN, 0, false, the first allowed text."""
        return (
            float("nan") if self.kind is float else self.allowed[0] if self.allowed else self.kind()
        )


def column(meaning: str, unit: str = "", **settings: Any) -> Any:
    """A dataclass field that is a column of a table. settings: of `dataclasses.field`."""
    return field(metadata={"meaning": meaning, "unit": unit}, **settings)


def columns(row: type) -> tuple[Column, ...]:
    """The columns of a dataclass whose fields are all declared by `column`, in their order."""
    hints = get_type_hints(row)
    return tuple(Column(f.name, *_typed(hints[f.name], **f.metadata)) for f in fields(row))


def _typed(hint: Any, meaning: str, unit: str) -> tuple[Kind, str, str, tuple[str, ...]]:
    if get_origin(hint) is Literal:
        return str, meaning, unit, get_args(hint)
    return hint, meaning, unit, ()
