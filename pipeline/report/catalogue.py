"""How `snakemake --report` lists a study's pages and plots; captions: pipeline/rules/captions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath

PAGES, SEARCH, COMPARISON, DETECTOR, FRONT_CAR = (
    "Pages",
    "Search",
    "Comparison of versions",
    "Detector and frames",
    "Front car",
)
CATEGORIES: Mapping[str, str] = {
    "page": PAGES,
    "evidence": PAGES,
    "detector": PAGES,
    "front_car": PAGES,
    "theta": SEARCH,
    "coverage": SEARCH,
    "kpi": SEARCH,
    "pairs": SEARCH,
    "failures": SEARCH,
    "comparison": COMPARISON,
    "histogram": COMPARISON,
    "rounds": COMPARISON,
    "detection": DETECTOR,
    "reliability": DETECTOR,
    "border": DETECTOR,
    "table": FRONT_CAR,
    "growth": FRONT_CAR,
    "gallery": FRONT_CAR,
    "by_condition": FRONT_CAR,
}
"""The category of each kind of page or plot."""
FOLDERS = {"evidence": "evidence", "reports": "detector"}


@dataclass(frozen=True)
class Entry:
    """A page or a plot in the report. labels: the columns of its row."""

    kind: str
    labels: tuple[tuple[str, str], ...]

    @property
    def category(self) -> str:
        return CATEGORIES[self.kind]

    @property
    def caption(self) -> str:
        """Its caption, relative to the rules."""
        return f"captions/{self.kind}.rst"


def entry(path: str) -> Entry:
    """The entry of a page (.html) or a plot (.png); `path` may contain wildcards in braces."""
    file = PurePosixPath(path)
    if file.suffix == ".html":
        kind = FOLDERS.get(file.parent.name, "front_car" if file.stem == "front_car" else "page")
        of = file.stem if file.parent.name in FOLDERS else "the study"
        return Entry(kind, (("page", kind.replace("_", " ")), ("of", of)))
    kind, scenario = (file.stem, "") if file.stem in CATEGORIES else file.stem.split("_", 1)
    return Entry(kind, (("plot", kind.replace("_", " ")), ("of", scenario or "the study")))
