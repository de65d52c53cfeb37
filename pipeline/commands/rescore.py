"""Command `rescore`: judges the stored tests of campaigns again, at other IoUs and thresholds."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.artefacts.files import check_output
from pipeline.artefacts.tables import is_valid
from pipeline.config.arguments import whole
from pipeline.config.components import STORED_FROM
from pipeline.config.composing import PARAMS, load
from pipeline.config.project import typed
from pipeline.config.schema import Config
from pipeline.errors import InputError
from pipeline.progress import Progress

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.core.car import Car
    from pipeline.core.identity import CampaignId

HELP = "Judge stored tests again at other IoUs and thresholds."


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folders",
        type=typed,
        nargs="+",
        help="folders with campaigns, such as data/default/campaigns",
    )
    parser.add_argument(
        "--iou",
        type=float,
        nargs="+",
        default=[0.1, 0.2, 0.3, 0.4, 0.5],
        help="IoU above which a detection matches",
    )
    parser.add_argument(
        "--threshold",
        type=float,
        nargs="+",
        help="score from which a detection is reported (default: the study's)",
    )
    parser.add_argument(
        "--drive",
        action="store_true",
        help="execute again the tests in which the car would have braked differently",
    )
    parser.add_argument(
        "--workers", type=whole(1), default=2, help="processes for --drive (default: %(default)s)"
    )
    parser.add_argument(
        "--params",
        type=typed,
        default=PARAMS,
        help="params.yaml of the study (default: %(default)s)",
    )
    parser.add_argument("--out", type=typed, help="write the table as CSV")


def run(options: argparse.Namespace) -> int:
    """Check that the stored tests follow from their detections; print the failures at each IoU and threshold.

    Exit code 1 if they do not follow.
    """
    import pandas as pd

    from pipeline.artefacts.recorded_tests import tables_below
    from pipeline.artefacts.tables import campaign_of, read_tests

    config = load(options.params)
    if options.out:
        check_output(options.out)
    cars = asked(config, options)
    campaigns = {
        path.parent: campaign_of(read_tests(path), path) for path in tables_below(options.folders)
    }
    if options.drive:
        check_campaigns(campaigns, config)
    wrong = [problem for folder in campaigns for problem in disagreements(folder, config)]
    print(
        "\n".join(wrong)
        or f"all {len(campaigns)} campaigns: every KPI follows from detections.parquet and signals.parquet"
    )
    rows = [
        {
            **{"version": version, "threshold": car.criterion.threshold, "iou": car.criterion.iou},
            **summed([judged(folder, config, car, options) for folder in folders]),
        }
        for car in cars
        for version, folders in by_version(campaigns).items()
    ]
    table = pd.DataFrame(rows).fillna(0)
    table = table.astype(
        {name: int for name in table if name not in ("version", "threshold", "iou")}
    )
    print(table.to_string(index=False))
    if options.out:
        table.to_csv(options.out, index=False)
    return 1 if wrong else 0


def asked(config: Config, options: argparse.Namespace) -> list[Car]:
    """The study's car at each threshold and IoU; InputError for one out of range."""
    from pipeline.analysis.rescoring import with_criterion

    thresholds, lowest = options.threshold or [config.threshold], min(STORED_FROM, config.threshold)
    if min(thresholds) < lowest:
        raise InputError(
            f"--threshold must be at least {lowest:g}, the lowest score that the study's tests store; got {min(thresholds):g}"
        )
    try:
        return [
            with_criterion(config.car, iou, threshold)
            for threshold in thresholds
            for iou in options.iou
        ]
    except ValueError as error:
        raise InputError(f"--iou and --threshold: {error}") from error


def check_campaigns(campaigns: Mapping[Path, CampaignId], config: Config) -> None:
    """InputError for a campaign that the study cannot execute, because it lacks the scenario or the version. campaigns: by folder."""
    known = {"scenario": config.scenarios, "version": [str(version) for version in config.versions]}
    for folder, campaign in campaigns.items():
        for kind, names in known.items():
            if (name := getattr(campaign, kind)) not in names:
                path, wanted = folder / "tests.parquet", ", ".join(names)
                raise InputError(
                    f"{path}: expected a {kind} of study {config.study} ({wanted}), got '{name}'"
                )


def by_version(campaigns: Mapping[Path, CampaignId]) -> dict[str, list[Path]]:
    """The folders of campaigns by the version that they test."""
    found: dict[str, list[Path]] = {}
    for folder, campaign in campaigns.items():
        found.setdefault(campaign.version, []).append(folder)
    return found


def disagreements(folder: Path, config: Config) -> list[str]:
    """The columns of tests.parquet that differ from what detections.parquet and signals.parquet give, one text each."""
    import pandas as pd

    from pipeline.analysis.rescoring import kpis, rescored
    from pipeline.artefacts.tables import read_detections, read_signals

    tests, signals = valid_tests(folder), read_signals(folder / "signals.parquet")
    again = kpis(
        rescored(signals, read_detections(folder / "detections.parquet"), config.car),
        config.campaign.failure_threshold_s,
    )
    stored = tests.set_index("test_id")[list(again)].reindex(again.index)
    different = {
        name: int(
            (~(stored[name].eq(again[name]) | (stored[name].isna() & again[name].isna()))).sum()
        )
        for name in again
    }
    missing = len(pd.Index(tests["test_id"]).symmetric_difference(again.index))
    texts = [
        f"{folder}: {name} differs in {count} of {len(again)} tests"
        for name, count in different.items()
        if count
    ]
    return texts + (
        [f"{folder}: {missing} tests have no signals, or signals no test"] if missing else []
    )


def valid_tests(folder: Path) -> pd.DataFrame:
    """The tests of a campaign that are no errors."""
    from pipeline.artefacts.tables import read_tests

    tests = read_tests(folder / "tests.parquet")
    return tests[is_valid(tests)]


def judged(folder: Path, config: Config, car: Car, options: argparse.Namespace) -> dict[str, int]:
    """Failures of a campaign with another car, by cause: as driven, and with --drive as the car would have driven."""
    from pipeline.artefacts.folders import Folders
    from pipeline.artefacts.tables import campaign_of, read_tests
    from pipeline.execution.again import driven_again, judged_again
    from pipeline.execution.points import Executor
    from pipeline.execution.workers import Setup

    path, threshold_s = folder / "tests.parquet", config.campaign.failure_threshold_s
    campaign = campaign_of(read_tests(path), path)
    again = judged_again(folder, car, threshold_s)
    tests, left = again.tests, len(again.others)
    if options.drive and again.others:
        setup = replace(
            Setup.recorded(Folders(config), campaign.scenario, campaign.version), car=car
        )
        label = (
            f"{campaign.scenario}, IoU {car.criterion.iou:g}, threshold {car.criterion.threshold:g}"
        )
        with tempfile.TemporaryDirectory() as scratch, Progress(label) as progress:
            executor = Executor(setup, Path(scratch) / "journal", options.workers, progress)
            tests, left = (
                driven_again(again, config.space(campaign.scenario), threshold_s, executor),
                0,
            )
    valid = tests[is_valid(tests)]
    failed = valid[valid["failure"].astype(bool)]
    causes = failed["cause"].value_counts().sort_index()
    return {
        "tests": len(valid),
        "failures": len(failed),
        "would drive otherwise": left,
        **{str(k): int(v) for k, v in causes.items()},
    }


def summed(counts: Sequence[dict[str, int]]) -> dict[str, int]:
    """The sums by name."""
    names = dict.fromkeys(name for one in counts for name in one)
    return {name: sum(one.get(name, 0) for one in counts) for name in names}
