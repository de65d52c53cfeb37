"""Command `versions`: the registered model versions."""

from __future__ import annotations

import argparse

from pipeline.config.project import typed
from pipeline.report.formats import in_columns
from pipeline.tracking import STORE

HELP = "Print the registered model versions with their failures."
COLUMNS = (
    "model",
    "number",
    "version",
    "study",
    "failures",
    "failures_by_ttc",
    "tests",
    "verdict",
    "alias",
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--store", type=typed, default=STORE, help="MLflow's database (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Print a row for each version."""
    from pipeline.tracking.registry import registered

    rows: list[tuple[str, ...]] = [COLUMNS]
    for version in registered(options.store):
        rows.append(tuple(version.get(name, "") for name in COLUMNS))
    print("\n".join(in_columns(rows)))
    return 0
