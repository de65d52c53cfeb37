"""The report as one HTML page that loads nothing from elsewhere.

Figures are inline SVG, films are data: addresses, scripts are inline.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from pipeline.report import texts
from pipeline.report.explorer import Explorer
from pipeline.report.style import svg

ASSETS = Path(__file__).parent / "assets"


@dataclass(frozen=True)
class Table:
    """Cells as text.

    Attributes:
        numbers: Indices of columns that must not wrap.
        codes: Indices of columns in a monospaced font.
    """

    headers: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: tuple[int, ...] = ()
    codes: tuple[int, ...] = ()


@dataclass(frozen=True)
class Drawing:
    """A figure as inline SVG, and how to read it."""

    svg: str
    how: str

    @staticmethod
    def of(figure: Figure, how: str) -> Drawing:
        """A figure; a screen reader announces it by `how`."""
        return Drawing(svg(figure, how), how)


@dataclass(frozen=True)
class Film:
    """A replay: video and poster as data: addresses."""

    test_id: str
    title: str
    caption: str
    video: str
    poster: str


@dataclass(frozen=True)
class Still:
    """An image as a data: address."""

    caption: str
    image: str


@dataclass(frozen=True)
class BeforeAfter:
    """One test with two versions."""

    title: str
    before: Still
    after: Still


@dataclass(frozen=True)
class FirstScreen:
    """One fix beside the headline.

    Attributes:
        title: The person and the place.
        films: Of both versions.
        stills: Instead of films.
    """

    title: str
    text: str = ""
    films: tuple[Film, ...] = ()
    stills: BeforeAfter | None = None


@dataclass(frozen=True)
class Bar:
    """One bar of a list: `value` of `most`, and the same in words."""

    label: str
    value: int
    most: int
    text: str


@dataclass(frozen=True)
class Box:
    """A box on a picture, in its pixels.

    Attributes:
        kind: `truth`, `reported` or `unreported`.
        label: Its score.
    """

    left: float
    top: float
    right: float
    bottom: float
    kind: str
    label: str = ""


@dataclass(frozen=True)
class Picture:
    """A frame of a test.

    Attributes:
        image: A data: address.
        size: Width and height in pixels.
        words: Description of the frame.
    """

    test_id: str
    image: str
    size: tuple[int, int]
    boxes: tuple[Box, ...]
    words: str


@dataclass(frozen=True)
class Card:
    """A group of failures.

    Attributes:
        name: Its name in the table of every test.
        tag: Shown beside the name.
        text: A sentence about the group.
        members: Number of failures.
        facts: Names and values.
        fewer: Why it has few pictures.
        bars: Failures that pass with one change.
        test: A test to execute again.
    """

    name: str
    tag: str
    text: str
    rule: str
    members: int
    facts: tuple[tuple[str, str], ...]
    pictures: tuple[Picture, ...]
    fewer: str
    bars: tuple[Bar, ...]
    replays: tuple[Film, ...]
    test: str


@dataclass(frozen=True)
class Passage:
    """A titled part of a section; empty fields are left out.

    Attributes:
        notes: A list below the table.
        folded: The label that opens the table.
    """

    title: str = ""
    text: str = ""
    table: Table | None = None
    plots: tuple[Drawing, ...] = ()
    replays: tuple[Film, ...] = ()
    stills: tuple[BeforeAfter, ...] = ()
    notes: tuple[str, ...] = ()
    folded: str = ""
    cards: tuple[Card, ...] = ()


@dataclass(frozen=True)
class Section:
    """A section: paragraphs, then parts."""

    title: str
    texts: tuple[str, ...]
    parts: tuple[Passage, ...]


@dataclass(frozen=True)
class Page:
    """The whole page.

    Attributes:
        headline: The result in one or two sentences.
        explorer: Every test, if the page shows them.
        first: Shown below the headline.
    """

    study: str
    headline: str
    sections: tuple[Section, ...]
    title: str = "Where does the detector fail, and did retraining help?"
    explorer: Explorer | None = None
    first: FirstScreen | None = None


def render(page: Page) -> str:
    """The page as HTML; texts and cells are escaped."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_unbroken,
    )
    template = environment.get_template("page.html.jinja")
    return template.render(page=page, asset=_asset, first_how=texts.FIRST)


def _unbroken(value: Any) -> Any:
    """The text with no-break spaces before per cent signs, so that no line begins with one."""
    if isinstance(value, str) and not isinstance(value, Markup):
        return value.replace(" %", "\u00a0%")
    return value


def _asset(name: str) -> Markup:
    """A script or style of this package; the page's data never pass here."""
    return Markup((ASSETS / name).read_text())
