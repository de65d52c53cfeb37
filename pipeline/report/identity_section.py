"""The report's last section before the table: which tests, seeds and files it was made from, and what it does not show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import pandas as pd

from pipeline.artefacts.model_card import ModelCard
from pipeline.artefacts.tables import is_valid
from pipeline.report import texts
from pipeline.report.page import Passage, Section, Table


def identity_section(
    tests: pd.DataFrame,
    labels: Mapping[str, str],
    cards: Sequence[ModelCard],
    files: Mapping[str, str],
    settings: Sequence[tuple[str, str]],
) -> Section:
    """What the page stands on. tests: every row that it shows. labels: of scenarios. files: path -> SHA-256. settings: names and values."""
    headers = ("scenario", "strategy", "version", "seeds", "tests", "errors")
    parts = [
        Passage("What it does not show", notes=texts.NOT_SHOWN),
        Passage(
            "Tests and seeds",
            texts.SEEDS,
            Table(headers, tuple(_campaigns(tests, labels)), numbers=(3, 4, 5)),
        ),
        Passage("Settings", table=Table(("setting", "value"), tuple(settings), codes=(1,))),
        *([Passage("Model versions", table=_versions(cards))] if cards else []),
        Passage(
            table=Table(("file", "SHA-256"), tuple(files.items()), codes=(0, 1)),
            folded=f"Files that this page was made from ({len(files)})",
        ),
    ]
    return Section("Limits, seeds and hashes", (), tuple(parts))


def _campaigns(tests: pd.DataFrame, labels: Mapping[str, str]) -> Iterator[tuple[str, ...]]:
    """A row for each scenario, strategy and version."""
    for (scenario, strategy, version), rows in tests.groupby(
        ["scenario", "strategy", "version"], sort=False
    ):
        seeds = ", ".join(map(str, sorted(rows["seed"].unique())))
        yield (
            labels.get(scenario, scenario),
            strategy,
            version,
            seeds,
            str(len(rows)),
            str(int((~is_valid(rows)).sum())),
        )


def _versions(cards: Sequence[ModelCard]) -> Table:
    rows = tuple(
        (card.version, card.parent or "none", str(card.seed), card.weights_sha256) for card in cards
    )
    return Table(
        ("version", "parent", "seed of its training", "SHA-256 of its weights"),
        rows,
        numbers=(2,),
        codes=(3,),
    )
