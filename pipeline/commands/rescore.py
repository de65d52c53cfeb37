"""Command `rescore`: judges the stored tests of campaigns again, at other IoUs and thresholds."""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    from pipeline.core.car import Car
    from pipeline.core.identity import CampaignId

HELP = "Judge stored tests again at other IoUs and thresholds."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
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
    """Print the failures at each IoU and threshold.

    Exit code 1 if the stored tests do not follow from their detections.
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
    files = "detections.parquet and signals.parquet"
    print("\n".join(wrong) or f"all {len(campaigns)} campaigns: every KPI follows from {files}")
    rows: list[dict[str, Any]] = []
    for car in cars:
        counts: dict[str, Counter[str]] = {}
        for folder, campaign in campaigns.items():
            of_version = counts.setdefault(campaign.version, Counter())
            of_version.update(judged(folder, config, car, options))
        criterion = {"threshold": car.criterion.threshold, "iou": car.criterion.iou}
        rows += [{"version": name, **criterion, **counts[name]} for name in counts]
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
            f"--threshold must be at least {lowest:g}, the lowest score that the study's tests "
            f"store; got {min(thresholds):g}"
        )
    criteria = product(thresholds, options.iou)
    try:
        return [with_criterion(config.car, iou, threshold) for threshold, iou in criteria]
    except ValueError as error:
        raise InputError(f"--iou and --threshold: {error}") from error


def check_campaigns(campaigns: Mapping[Path, CampaignId], config: Config) -> None:
    """Check that the study can execute some campaigns.

    Args:
        campaigns: campaigns by folder.
        config: the config of the study.

    Raises:
        InputError: the study lacks the scenario or the version of a campaign.
    """
    choices = {"scenario": list(config.scenarios), "version": list(map(str, config.versions))}
    for folder, campaign in campaigns.items():
        for kind, names in choices.items():
            if (name := getattr(campaign, kind)) not in names:
                path, wanted = folder / "tests.parquet", ", ".join(names)
                raise InputError(
                    f"{path}: expected a {kind} of study {config.study} ({wanted}), got '{name}'"
                )


def disagreements(folder: Path, config: Config) -> list[str]:
    """A text for each column of tests.parquet that does not follow from the other tables."""
    import pandas as pd

    from pipeline.analysis.rescoring import kpis, rescored
    from pipeline.artefacts.tables import read_detections, read_signals, read_tests

    tests, signals = read_tests(folder / "tests.parquet"), read_signals(folder / "signals.parquet")
    tests = tests[is_valid(tests)]
    detections = read_detections(folder / "detections.parquet")
    threshold_s = config.campaign.failure_threshold_s
    again = kpis(rescored(signals, detections, config.car), threshold_s)
    stored = tests.set_index("test_id")[list(again)].reindex(again.index)
    texts = []
    for name in again:
        both_missing = stored[name].isna() & again[name].isna()
        count = int((~(stored[name].eq(again[name]) | both_missing)).sum())
        if count:
            texts.append(f"{folder}: {name} differs in {count} of {len(again)} tests")
    missing = len(pd.Index(tests["test_id"]).symmetric_difference(again.index))
    if missing:
        texts.append(f"{folder}: {missing} tests have no signals, or signals no test")
    return texts


def judged(folder: Path, config: Config, car: Car, options: argparse.Namespace) -> dict[str, int]:
    """Failures of a campaign with another car, by cause.

    They are counted as driven, and with --drive as the car would have driven.
    """
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
        recorded = Setup.recorded(Folders(config), campaign.scenario, campaign.version)
        iou, threshold = car.criterion.iou, car.criterion.threshold
        label = f"{campaign.scenario}, IoU {iou:g}, threshold {threshold:g}"
        with tempfile.TemporaryDirectory() as scratch, Progress(label) as progress:
            journal, setup = Path(scratch) / "journal", replace(recorded, car=car)
            executor = Executor(setup, journal, options.workers, progress)
            space = config.space(campaign.scenario)
            tests, left = driven_again(again, space, threshold_s, executor), 0
    valid = tests[is_valid(tests)]
    failed = valid[valid["failure"].astype(bool)]
    causes = failed["cause"].value_counts().sort_index()
    return {
        "tests": len(valid),
        "failures": len(failed),
        "would drive otherwise": left,
        **{str(cause): int(count) for cause, count in causes.items()},
    }
