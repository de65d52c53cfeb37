"""The report's section on its limits, and on the tests, seeds and files that it is made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
    """The sources of the page.

    Args:
        tests: Every row that the page shows.
        labels: Scenario -> its printed label.
        cards: Model cards of the versions.
        files: Path -> SHA-256.
        settings: Names and values.
    """
    campaigns = ["scenario", "strategy", "version"]
    rows = []
    for (scenario, strategy, version), group in tests.groupby(campaigns, sort=False):
        seeds = ", ".join(map(str, sorted(group["seed"].unique())))
        counts = str(len(group)), str(int((~is_valid(group)).sum()))
        rows.append((labels.get(scenario, scenario), strategy, version, seeds, *counts))
    table = Table((*campaigns, "seeds", "tests", "errors"), tuple(rows), numbers=(3, 4, 5))
    parts = [
        Passage("What it does not show", notes=texts.NOT_SHOWN),
        Passage("Tests and seeds", texts.SEEDS, table),
        Passage("Settings", table=Table(("setting", "value"), tuple(settings), codes=(1,))),
    ]
    if cards:
        versions = []
        for card in cards:
            parent = card.parent or "none"
            versions.append((card.version, parent, str(card.seed), card.weights_sha256))
        headers = ("version", "parent", "seed of its training", "SHA-256 of its weights")
        table = Table(headers, tuple(versions), numbers=(2,), codes=(3,))
        parts.append(Passage("Model versions", table=table))
    hashes = Table(("file", "SHA-256"), tuple(files.items()), codes=(0, 1))
    folded = f"Files that this page was made from ({len(files)})"
    parts.append(Passage(table=hashes, folded=folded))
    return Section("Limits, seeds and hashes", (), tuple(parts))
