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
        if self.kind is float:
            return float("nan")
        return self.allowed[0] if self.allowed else self.kind()


def column(meaning: str, unit: str = "", **settings: Any) -> Any:
    """A dataclass field that is a column of a table. settings: of `dataclasses.field`."""
    return field(metadata={"meaning": meaning, "unit": unit}, **settings)


def columns(row: type) -> tuple[Column, ...]:
    """The columns of a dataclass whose fields are all declared by `column`, in their order."""
    hints = get_type_hints(row)
    result = []
    for each in fields(row):
        hint, meaning, unit = hints[each.name], each.metadata["meaning"], each.metadata["unit"]
        if get_origin(hint) is Literal:
            result.append(Column(each.name, str, meaning, unit, get_args(hint)))
        else:
            result.append(Column(each.name, hint, meaning, unit))
    return tuple(result)
