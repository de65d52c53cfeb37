"""Command `replay`: executes a test of the study again, as a film, and checks it."""

from __future__ import annotations

import argparse

import pandas as pd

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.points import concrete
from pipeline.artefacts.recorded_tests import params_of, recorded
from pipeline.config.composing import PARAMS, load
from pipeline.config.project import typed
from pipeline.core import kpi
from pipeline.core.columns import columns
from pipeline.core.kpi import Kpi

HELP = "Execute a test of the study again, write its replay and compare the result with its row."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "test",
        metavar="TEST_ID",
        help="as in tests.parquet and in the report, such as F1-forest-base-0-00012",
    )
    parser.add_argument(
        "--params",
        type=typed,
        help=f"configuration of the study (default: {PARAMS}, or the study that has the test)",
    )
    parser.add_argument(
        "--out", type=typed, default="replay.mp4", help=".mp4 or .gif (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Print whether the test ends as recorded; exit code 1 if it does not."""
    from pipeline.execution.workers import Setup, episode
    from pipeline.report.replays import Replay, check_replay, outcome_text, render_replay

    check_replay(options.out)
    config = load(options.params or params_of(options.test, PARAMS))
    folders = Folders(config)
    row = recorded(folders, options.test)
    scenario, version = str(row["scenario"]), str(row["version"])
    space = config.space(scenario)
    test = concrete(row, space)
    again = episode(Setup.recorded(folders, scenario, version, keep_every=1), test)
    threshold_s = config.campaign.failure_threshold_s
    replay = Replay(again, options.test, test, threshold_s, space.units)
    render_replay(replay, options.out, replay.frames_per_second)
    result = kpi.evaluate(again.signals, threshold_s)
    changed = differences(row, result)
    outcome = f"{outcome_text(result)}, adj. TTC {result.adj_ttc_s:.2f} s"
    print(f"{options.out}: {outcome}, {', '.join(changed) or 'as recorded'}")
    return 1 if changed else 0


def differences(row: pd.Series, result: Kpi) -> list[str]:
    """Every KPI that differs from the row, in words."""
    changed = []
    for name in (column.name for column in columns(Kpi)):
        if name not in row.index:
            continue
        before, after = row[name], getattr(result, name)
        if before != after and not (pd.isna(before) and pd.isna(after)):
            changed.append(f"{name} {after} instead of {before}")
    return changed
