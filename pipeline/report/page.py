"""The report as one HTML page that loads nothing from elsewhere: figures are inline SVG, films are data: addresses, scripts are inline."""

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
    """Cells as text. numbers: columns that must not wrap; codes: columns in a monospaced font."""

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
        """The figure, which a screen reader announces by how to read it."""
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
    """One fix beside the headline. title: the person and the place. films: of both versions; stills: instead of films."""

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
    """A box on a picture, in its pixels. kind: `truth`, `reported` or `unreported`. label: its score."""

    left: float
    top: float
    right: float
    bottom: float
    kind: str
    label: str = ""


@dataclass(frozen=True)
class Picture:
    """A frame of a test. image: as a data: address. size: width and height in pixels. words: what is to be seen."""

    test_id: str
    image: str
    size: tuple[int, int]
    boxes: tuple[Box, ...]
    words: str


@dataclass(frozen=True)
class Card:
    """A group of failures. name: as the table of every test has it. tag: beside the name. text: a sentence. facts: names and values.
    members: number of its failures. fewer: why it has few pictures. bars: what repairs it. test: one to execute again."""

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
    """A titled part of a section; empty fields are left out. notes: a list below the table. folded: the label that opens the table."""

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
    """The whole page. headline: the result in one or two sentences. explorer: every test, if the page shows them. first: below the
    headline."""

    study: str
    headline: str
    sections: tuple[Section, ...]
    title: str = "Where does the detector fail, and did retraining help?"
    explorer: Explorer | None = None
    first: FirstScreen | None = None


def render(page: Page) -> str:
    """The page as HTML; texts and cells are escaped."""
    loader = FileSystemLoader(Path(__file__).parent)
    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_unbroken,
    )
    return environment.get_template("page.html.jinja").render(
        page=page, asset=_asset, first_how=texts.FIRST
    )


def _unbroken(value: Any) -> Any:
    """The text with no-break spaces before per cent signs, so that no line begins with one."""
    return (
        value.replace(" %", "\u00a0%")
        if isinstance(value, str) and not isinstance(value, Markup)
        else value
    )


def _asset(name: str) -> Markup:
    """A script or style of ours; the page's own data never pass here."""
    return Markup((ASSETS / name).read_text())
