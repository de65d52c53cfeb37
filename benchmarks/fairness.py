"""Is the world fair? How often the oracle, or another detector, fails in random tests.

`python benchmarks/fairness.py [--tests 300] [--scenario F1 N1] [--detector oracle|blind|everywhere|models/uniform] [--study thesis]
[--seed 6] [--out fairness.csv] [--outcomes fairness.csv.gz] [key=value ...]`

Runs F1 to F8 and F1* to F4* with the car, camera and brake law of a study, and N1 to N4, in which the right answer is not to brake, with
`aeb.gate=detections`. Finished tests stay in the folder `--journal`, so the same command resumes a killed run.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
from outcomes import ERROR, write
from who_fails import groups

from pipeline.artefacts.files import write_bytes
from pipeline.config.composing import compose, functional_scenario
from pipeline.core.identity import CampaignId
from pipeline.core.kpi import NO_KPI, Kpi
from pipeline.core.statistics import wilson_interval
from pipeline.detectors.yolo.export import onnx_of
from pipeline.execution.campaign import CampaignPlan, search
from pipeline.execution.journal import Journal
from pipeline.execution.workers import Setup, Workers
from pipeline.progress import Progress

FAIR = [f"F{number}" for number in range(1, 9)] + [f"F{number}star" for number in range(1, 5)]
NO_BRAKING = [f"N{number}" for number in range(1, 5)]
SCRIPTED = ("oracle", "blind", "everywhere")
HOW = (
    "failure_mode",
    "cause",
    "false_positives_far",
    "false_positives_localisation",
    "false_positives_duplicate",
)
SHOWN = 3
"""Failures of a scenario that are printed as commands."""


def main() -> None:
    """Execute random tests and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tests", type=int, default=300, help="tests per scenario")
    parser.add_argument("--scenario", nargs="+", default=[*FAIR, *NO_BRAKING])
    parser.add_argument(
        "--detector", default="oracle", help="oracle, blind, everywhere or the folder of a version"
    )
    parser.add_argument(
        "--seed", type=int, default=5, help="of the random tests (default: %(default)s)"
    )
    parser.add_argument(
        "--study", default="default", help="whose settings hold (default: %(default)s)"
    )
    parser.add_argument(
        "overrides",
        nargs="*",
        metavar="key=value",
        help="settings of the study to change, such as camera=640x384",
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--journal", type=Path, default=Path("data/fairness"))
    parser.add_argument("--out", type=Path, help="CSV of the table")
    parser.add_argument("--outcomes", type=Path, help="CSV of every test")
    options = parser.parse_args()
    folder = options.journal / options.detector.replace("/", "_")
    model = model_of(options.detector, folder)
    rows, tests = [], []
    for name in options.scenario:
        planned = plan(
            name,
            options.detector,
            model,
            options.tests,
            options.overrides,
            options.study,
            options.seed,
        )
        with Progress(name) as progress:
            done = executed(planned, folder / name, options.workers, progress)
            rows.append(row(planned, done, progress))
            tests.append(outcomes(planned, done))
    table = pd.DataFrame(rows)
    print(table.to_string(index=False, na_rep="–", float_format="{:.4g}".format))
    if options.out is not None:
        write_bytes(
            options.out,
            table.to_csv(index=False, lineterminator="\n", float_format="%.6g").encode(),
        )
    if options.outcomes is not None:
        write(pd.concat(tests), options.outcomes)


def model_of(detector: str, folder: Path) -> Path:
    """The detector's file; scripted detectors read none, so theirs is empty."""
    folder.mkdir(parents=True, exist_ok=True)
    if detector not in SCRIPTED:
        return onnx_of(Path(detector), folder)
    write_bytes(folder / "none", b"")
    return folder / "none"


def plan(
    scenario: str,
    detector: str,
    model: Path,
    tests: int,
    overrides: Sequence[str] = (),
    study: str = "default",
    seed: int = 5,
) -> CampaignPlan:
    """Random tests of a scenario in one batch, so that no worker waits for another."""
    described = functional_scenario(scenario)
    gate = "truth" if described.asks_to_brake else "detections"
    config = compose(
        study,
        [
            f"aeb.gate={gate}",
            *([f"detector={detector}"] if detector in SCRIPTED else []),
            *overrides,
        ],
    )
    campaign = CampaignId(scenario, "random", "base", seed)
    return CampaignPlan(
        campaign=campaign,
        space=described.logical_space(),
        tests=tests,
        failure_threshold_s=config.campaign.failure_threshold_s,
        strategy={**config.samplers["random"], "batch_size": tests},
        setup=Setup(config.simulator, described, config.detector, model, config.car, config.limits),
    )


def executed(
    planned: CampaignPlan, folder: Path, workers: int, progress: Progress
) -> list[tuple[dict[str, float | str], Kpi | None]]:
    """Every test with its KPIs, None for an error."""
    with closing(Workers(workers, planned.setup)) as pool:
        done = search(
            planned, planned.sampler(), Journal(folder, planned.identity, progress), pool, progress
        )
    return [
        (dict(planned.space.decode(test.point)), None if test.outcome.is_error else test.kpi)
        for test in done
    ]


def row(
    planned: CampaignPlan,
    done: Sequence[tuple[dict[str, float | str], Kpi | None]],
    progress: Progress,
) -> dict[str, float | str]:
    """A scenario's row of the table."""
    judged = [kpi for _, kpi in done if kpi is not None]
    for command in list(commands(planned.campaign.scenario, done))[:SHOWN]:
        progress.note(command)
    failures = sum(kpi.failure for kpi in judged)
    low, high = wilson_interval(failures, len(judged))
    braking = [kpi for kpi in judged if kpi.false_activations]
    number = sum(kpi.false_activations for kpi in braking)
    return {
        "scenario": planned.campaign.scenario,
        "tests": len(judged),
        "errors": len(done) - len(judged),
        "failures": failures,
        "rate_%": 100 * failures / max(1, len(judged)),
        "low_%": 100 * low,
        "high_%": 100 * high,
        "contacts": sum(kpi.contact for kpi in judged),
        "false_positives": sum(kpi.failure_mode == "false_positives" for kpi in judged),
        "not_solvable": sum(kpi.cause == "not_solvable" for kpi in judged),
        "false_activations": number,
        "mean_duration_s": sum(kpi.false_activation_s for kpi in braking) / number
        if number
        else float("nan"),
        "mean_speed_loss_mps": sum(kpi.speed_loss_mps for kpi in braking) / len(braking)
        if braking
        else float("nan"),
    }


def outcomes(
    planned: CampaignPlan, done: Sequence[tuple[dict[str, float | str], Kpi | None]]
) -> pd.DataFrame:
    """Every test: who walks how, 0 passed, 1 failed, 2 ended in an error, and how it failed."""
    points = np.array([planned.space.encode(concrete) for concrete, _ in done])
    judged = [NO_KPI if kpi is None else kpi for _, kpi in done]
    return pd.DataFrame(
        {
            "scenario": planned.campaign.scenario,
            "index": np.arange(len(done)),
            **{
                name: [concrete[name] for concrete, _ in done]
                for name in ("animation", "blueprint")
            },
            "group": groups(planned.space, points),
            "outcome": [ERROR if kpi is None else int(kpi.failure) for _, kpi in done],
            **{name: [getattr(kpi, name) for kpi in judged] for name in HOW},
        }
    )


def commands(
    scenario: str, done: Sequence[tuple[dict[str, float | str], Kpi | None]]
) -> Iterator[str]:
    """A command for each failure that executes it in the default study; add `--model` for another detector than models/uniform."""
    for concrete, kpi in done:
        if kpi is not None and kpi.failure:
            words = [
                f"'{key}={value}'" if isinstance(value, str) else f"{key}={value!r}"
                for key, value in concrete.items()
            ]
            yield f"{kpi.failure_mode}, {kpi.cause}: python -m pipeline simulate {scenario} {' '.join(words)}"


if __name__ == "__main__":
    main()
