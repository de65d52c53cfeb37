"""The style of the report's figures: one palette, and SVG in the text colour of the page."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from pathlib import Path

import matplotlib
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pipeline.artefacts.files import write_bytes

INK = "#39424e"
GRID = "#8f98a3"
MODE_COLOURS: Mapping[str, str] = {
    "contact": "#c9372c",
    "late": "#e8912d",
    "false_positives": "#8f6bc9",
    "false_activation": "#3a8f9c",
    "none": "#7f93ab",
}
MODE_NAMES: Mapping[str, str] = {
    "contact": "contact",
    "late": "late (TTC alone)",
    "false_positives": "false positives alone",
    "false_activation": "unnecessary braking",
    "none": "no failure",
}
SERIES = (
    "#3b7dd8",
    "#e0682e",
    "#2a9d78",
    "#8f6bc9",
    "#b9912b",
    "#c9497c",
    "#5a8f3c",
    "#4aa3b5",
    "#a0624a",
    "#7f93ab",
)
UNASSIGNED = "#a3acb8"
PAGE_INCHES = 9.2
"""Width of a figure that fills the page."""

_RC = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "text.color": INK,
    "text.parse_math": False,  # A dollar in a label is a dollar.
    "axes.labelcolor": INK,
    "axes.edgecolor": GRID,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.alpha": 0.22,
    "grid.linewidth": 0.7,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "svg.hashsalt": "blindspot",
}


@contextmanager
def styled(changes: Mapping[str, object] | None = None) -> Iterator[None]:
    """Apply the report's style, with changes, inside the block."""
    with matplotlib.rc_context({**_RC, **(changes or {})}):
        yield


def panels(
    rows: int, columns: int, *, width: float, height: float, sharey: bool = True
) -> tuple[Figure, list[list[Axes]]]:
    """A figure of rows x columns panels, made without pyplot's global state and display.

    Args:
        rows: Number of rows.
        columns: Number of columns.
        width: Width of a panel in inches.
        height: Height of a panel in inches.
        sharey: Whether all panels share their y axis.

    Returns:
        The figure, and its axes row by row.
    """
    figure = Figure(figsize=(width * columns, height * rows))
    grid = figure.subplots(rows, columns, squeeze=False, sharey=sharey)
    return figure, [list(row) for row in grid]


def wrapped(
    count: int, columns: int, *, height: float, ylabel: str, sharey: bool = True
) -> tuple[Figure, list[Axes]]:
    """A figure as wide as the page, with its panels in rows; one y label a row.

    Args:
        count: Number of panels.
        columns: Largest number of panels in a row.
        height: Height of a panel in inches.
        ylabel: Label of the y axes.
        sharey: Whether all panels share their y axis.

    Returns:
        The figure, and the axes of its panels.
    """
    columns = min(columns, count)
    figure, axes = panels(
        -(-count // columns), columns, width=PAGE_INCHES / columns, height=height, sharey=sharey
    )
    flat = [axis for line in axes for axis in line]
    for axis in flat[count:]:
        axis.set_axis_off()
    for axis in flat[::columns]:
        axis.set_ylabel(ylabel)
    return figure, flat[:count]


def whole_numbers(*axes: Axis) -> None:
    """Put the ticks of axes that count at whole numbers."""
    for axis in axes:
        axis.set_major_locator(MaxNLocator(integer=True))


def legend_below(figure: Figure, axes: Sequence[Axes]) -> None:
    """One legend for all panels, each name once."""
    entries: dict[str, Artist] = {}
    for axis in axes:
        for handle, name in zip(*axis.get_legend_handles_labels(), strict=True):
            entries.setdefault(name, handle)
    if entries:
        legend = figure.legend(
            list(entries.values()),
            list(entries),
            loc="outside lower center",
            ncols=min(5, len(entries)),
        )
        for shown in legend.legend_handles:
            if shown is not None:
                shown.set_alpha(1)


def series_colours(names: list[str] | tuple[str, ...]) -> dict[str, str]:
    """One colour for each name, in order; the palette repeats when it is used up."""
    return {name: SERIES[index % len(SERIES)] for index, name in enumerate(names)}


def svg(figure: Figure, label: str) -> str:
    """The figure as an inline SVG element in the text colour of the page.

    The same figure gives the same SVG. label: description for screen readers.
    """
    buffer = io.StringIO()
    with styled():
        metadata = {"Date": None, "Creator": None}
        figure.savefig(buffer, format="svg", transparent=True, dpi=150, metadata=metadata)
    text = buffer.getvalue()
    return (
        text[text.index("<svg") :]
        .replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1)
        .replace(INK, "currentColor")
    )


def save_png(figure: Figure, path: Path) -> None:
    """Write the figure as a PNG on white, atomically, without a date in it."""
    buffer = io.BytesIO()
    with styled():
        figure.savefig(
            buffer, format="png", dpi=130, facecolor="white", metadata={"Software": None}
        )
    write_bytes(path, buffer.getvalue())


def data_uri(content: bytes, media_type: str) -> str:
    """A file's content as a data: address, so that a page needs no other file."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode('ascii')}"
