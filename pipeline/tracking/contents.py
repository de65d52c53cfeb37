"""A study's content in MLflow: its runs and its registered versions."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, astuple
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.analysis.measures import count_modes
from pipeline.artefacts.comparison_results import Comparison, VersionResult
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.model_card import ModelCard, read_curve
from pipeline.artefacts.search_results import CampaignMeasures
from pipeline.artefacts.tables import campaign_of, is_valid
from pipeline.config.schema import BALANCED_SCENES, NEW_SCENES, Config
from pipeline.core.lineage import Version
from pipeline.core.measures import failure_sequence
from pipeline.detectors.suppression import IOU
from pipeline.tracking import UNTRACKED
from pipeline.tracking.registry import Registration
from pipeline.tracking.runs import Content, DataSet

WEIGHTS = "weights_sha256"
"""Tag of the run of a model version."""
COVERAGES = ("pair_coverage_tests", "pair_coverage_failures", "projection_coverage")
MEASURES = ("f_measure", "f_n", "c_measure", *COVERAGES)
"""Measures of a search that its run has, if they are defined."""
CURVES = ("learning_rate", "loss_scores", "loss_boxes", "ap50")
"""Columns of a training curve that a version's run has."""


def study_content(config: Config) -> Content:
    """The study as the parent of all other runs, with the parameters of params.yaml.

    The sections in `UNTRACKED` are left out.
    """
    plain = config.model_dump(mode="json", exclude=set(UNTRACKED))
    return Content(name=config.study, kind="study", params=dict(_flat(plain)))


def _flat(plain: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in plain.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            yield f"{prefix}{key}", " ".join(map(str, value))
        else:
            yield f"{prefix}{key}", str(value)


def campaign_content(
    study: str, tests: pd.DataFrame, measured: CampaignMeasures | None, path: Path
) -> Content:
    """One campaign as a run.

    Args:
        study: Name of the study.
        tests: Rows of the campaign.
        measured: Its measures, if it is a search.
        path: Its tests.parquet.

    Returns:
        Failures by mode, Θ as a series, measures and the table.
    """
    campaign = campaign_of(tests, path)
    theta = failure_sequence(tests.sort_values("index")["failure"].to_numpy(bool))
    modes = count_modes(tests)
    metrics = {
        "tests": len(tests),
        "errors": int((~is_valid(tests)).sum()),
        "failures": modes.total,
        "failures_by_ttc": modes.by_ttc,
    }
    for mode, count in modes:
        metrics[f"failures_{mode}"] = count
    for name in MEASURES if measured is not None else ():
        if (value := getattr(measured, name)) is not None:
            metrics[name] = value
    params = {"study": study} | asdict(campaign)
    return Content(
        name="/".join(map(str, (study, *astuple(campaign)))),
        kind="campaign",
        params={name: str(value) for name, value in params.items()},
        metrics={name: float(value) for name, value in metrics.items()},
        series={"failures_found": list(enumerate(map(float, theta), 1))},
        files=[path],
    )


def comparison_content(
    study: str, comparison: Comparison, path: Path, plots: Sequence[Path]
) -> Content:
    """The comparison as a run, with metrics `<name>.<version>`. path: its comparison.json."""
    metrics = {}
    for result in comparison.versions:
        for name, value in version_metrics(result).items():
            metrics[f"{name}.{result.version}"] = value
    params = {
        "study": study,
        "strategy": comparison.strategy,
        "scenarios": " ".join(comparison.scenarios),
        "sequence": comparison.sequence_digest[:16],
        "alpha": str(comparison.alpha),
        "champion": comparison.champion,
    }
    data = [DataSet("held_out", comparison.sequence_digest, f"data/{study}/held_out", "evaluation")]
    return Content(
        name=f"{study}/comparison",
        kind="comparison",
        params=params,
        metrics=metrics,
        files=[path],
        pictures=plots,
        data=data,
    )


def version_metrics(result: VersionResult) -> dict[str, float]:
    """A version's results on the held-out sequence; `failures.<scenario>` beside the total."""
    metrics: dict[str, float] = {
        "failures": result.failures,
        "failures_by_ttc": result.modes.by_ttc,
        "tests": result.tests,
        "errors": result.errors,
    }
    for scenario, count in failures_by_scenario(result).items():
        metrics[f"failures.{scenario}"] = count
    if result.paired is not None:
        metrics["fixes"] = len(result.paired.fixes)
        metrics["regressions"] = len(result.paired.regressions)
    metrics["failure_rate"] = result.rate
    if result.paired is not None:
        metrics["p_value_against_base"] = result.paired.p_value
        metrics["change_against_base"] = result.change
    return {name: float(value) for name, value in metrics.items()}


def failures_by_scenario(result: VersionResult) -> dict[str, int]:
    """Failures of a version on each held-out scenario."""
    return {name: part.failures for name, part in result.scenarios.items()}


def registration_of(
    config: Config, card: ModelCard, path: Path, comparison: Comparison, plots: Sequence[Path]
) -> Registration:
    """A registered model version. path: its model.json, beside its other files."""
    result = next(r for r in comparison.versions if r.version == card.version)
    tags = {
        "study": config.study,
        "version": card.version,
        "failures": str(result.failures),
        "verdict": result.verdict,
    }
    files = map(path.with_name, ("weights.safetensors", "model.onnx", "model.json"))
    return Registration(
        model=config.tracking.model_name,
        content=model_content(config, card, result, path, plots),
        files=[file for file in files if file.exists()],
        tags=tags,
    )


def model_content(
    config: Config, card: ModelCard, result: VersionResult, path: Path, plots: Sequence[Path]
) -> Content:
    """A model version as a run.

    Args:
        config: The study's configuration.
        card: Card of the version.
        result: Its result on the held-out tests.
        path: Its model.json, beside its other files.
        plots: Pictures to log.

    Returns:
        Parameters and curve of the training, data, detection metrics and failures.
    """
    params = {
        "version": card.version,
        "parent": card.parent or "none",
        "parameters": str(card.parameters),
        "seed": str(card.seed),
        "threshold": str(config.threshold),
        "iou": str(config.detector.get("iou", IOU)),
    }
    params |= {f"training.{name}": str(value) for name, value in card.training.items()}
    tags = {WEIGHTS: card.weights_sha256}
    tags |= {f"data.{name}": digest for name, digest in card.data.items()}
    curve = path.with_name("curve.csv")
    points = read_curve(curve) if curve.exists() else []
    series = {}
    for name in CURVES if points else ():
        series[f"training.{name}"] = [(point.iteration, getattr(point, name)) for point in points]
    shipped = card.parent is None and config.base.source == "shipped"
    base_set = config.base.weights if shipped else f"data/{config.study}/base_set"
    data = []
    for name, source in (("base_set", base_set), ("added", _added(config, card))):
        if name in card.data:
            data.append(DataSet(name, card.data[name], source, "training"))
    return Content(
        name=f"{config.study}/{card.version}",
        kind="model",
        params=params,
        metrics=card.metrics,
        series=series,
        tags=tags,
        data=data,
        pictures=plots,
        results=version_metrics(result),
    )


def _added(config: Config, card: ModelCard) -> str:
    """The folders of the images that a version was retrained on, besides the base set."""
    folders, arm = Folders(config), Version.named(card.version).arm
    if config.arms.get(arm) in (NEW_SCENES, BALANCED_SCENES):
        return f"{folders.root}/{folders.scenes(card.version, arm)}"
    if card.training.get("round", 0) in (0, 1):
        return f"{folders.root}/campaigns"
    return f"{folders.root}/campaigns {folders.root}/retrained/campaigns"


def git_commit() -> str:
    """The commit of the working directory; `unknown` outside a repository."""
    command = ["git", "rev-parse", "HEAD"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return "unknown"
    return done.stdout.strip() if done.returncode == 0 else "unknown"
