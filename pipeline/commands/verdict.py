"""Command `verdict`: prints the result of a study."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.artefacts.folders import Folders
from pipeline.config.composing import PARAMS, load
from pipeline.config.project import typed

HELP = "Print the verdict of a study."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--params",
        type=typed,
        default=PARAMS,
        help="resolved configuration of the study (default: %(default)s)",
    )
    parser.add_argument(
        "--comparison", type=typed, help="comparison.json (default: that of the study)"
    )


def run(options: argparse.Namespace) -> int:
    """Print the table; for a study without a report, print where its results are."""
    from pipeline.artefacts.comparison_results import Comparison
    from pipeline.artefacts.results import read
    from pipeline.report.verdict import verdict_table

    comparison: Path | None = options.comparison
    if comparison is None:
        folders = Folders(load(options.params))
        comparison = Path(folders.compared["comparison"])
        if folders.config.goal != "report":
            if len(folders.config.tested) > 1:
                print(f"{verdict_table(read(comparison, Comparison))}\n")
            print(f"Next: open {', '.join(folders.goals)}")
            return 0
    print(verdict_table(read(comparison, Comparison), comparison.with_name("report.html")))
    return 0
