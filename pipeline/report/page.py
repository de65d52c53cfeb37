"""The report as one HTML page that loads nothing from elsewhere: figures are inline SVG, films are data: addresses, scripts are inline."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from pipeline.report.explorer import Explorer

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
class Bar:
    """One bar of a list: `value` of `most`, and the same in words."""

    label: str
    value: int
    most: int
    text: str


@dataclass(frozen=True)
class Bars:
    """A paragraph with a list of bars."""

    title: str
    text: str
    bars: tuple[Bar, ...]


@dataclass(frozen=True)
class Passage:
    """A titled part of a section; empty fields are left out. notes: a list below the table. folded: the label that opens the table. bars:
    paragraphs below the notes."""

    title: str = ""
    text: str = ""
    table: Table | None = None
    plots: tuple[Drawing, ...] = ()
    replays: tuple[Film, ...] = ()
    stills: tuple[BeforeAfter, ...] = ()
    notes: tuple[str, ...] = ()
    folded: str = ""
    bars: tuple[Bars, ...] = ()


@dataclass(frozen=True)
class Section:
    """A section: paragraphs, then parts."""

    title: str
    texts: tuple[str, ...]
    parts: tuple[Passage, ...]


@dataclass(frozen=True)
class Page:
    """The whole page. headline: the result in one or two sentences. explorer: every test, if the page shows them."""

    study: str
    headline: str
    sections: tuple[Section, ...]
    title: str = "Where does the detector fail, and did retraining help?"
    explorer: Explorer | None = None


def render(page: Page) -> str:
    """The page as HTML; texts and cells are escaped."""
    loader = FileSystemLoader(Path(__file__).parent)
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.get_template("page.html.jinja").render(page=page, asset=_asset)


def _asset(name: str) -> Markup:
    """A script or style of ours; the page's own data never pass here."""
    return Markup((ASSETS / name).read_text())
