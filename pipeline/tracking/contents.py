"""A study's content in MLflow: of each run, and of each registered version."""

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


def study_content(config: Config) -> Content:
    """The study as the parent of all other runs; its parameters are those of params.yaml, except `UNTRACKED`."""
    plain = {
        key: value for key, value in config.model_dump(mode="json").items() if key not in UNTRACKED
    }
    return Content(name=config.study, kind="study", params=dict(_flat(plain)))


def _flat(plain: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in plain.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield (
                f"{prefix}{key}",
                " ".join(map(str, value)) if isinstance(value, list) else str(value),
            )


def campaign_content(
    study: str, tests: pd.DataFrame, measured: CampaignMeasures | None, path: Path
) -> Content:
    """One campaign as a run: failures by mode, Θ as a series, the measures if it is a search, the table."""
    campaign = campaign_of(tests, path)
    theta = failure_sequence(tests.sort_values("index")["failure"].to_numpy(bool))
    modes = count_modes(tests)
    metrics = {
        "tests": len(tests),
        "errors": int((~is_valid(tests)).sum()),
        "failures": modes.total,
    }
    metrics |= {
        "failures_by_ttc": modes.by_ttc,
        **{f"failures_{mode}": count for mode, count in modes},
    }
    if measured is not None:
        names = (
            "f_measure",
            "f_n",
            "c_measure",
            "pair_coverage_tests",
            "pair_coverage_failures",
            "projection_coverage",
        )
        metrics |= {name: value for name in names if (value := getattr(measured, name)) is not None}
    return Content(
        name="/".join(map(str, (study, *astuple(campaign)))),
        kind="campaign",
        params={"study": study, **{name: str(value) for name, value in asdict(campaign).items()}},
        metrics={name: float(value) for name, value in metrics.items()},
        series={
            "failures_found": [(position, float(count)) for position, count in enumerate(theta, 1)]
        },
        files=[path],
    )


def comparison_content(
    study: str, comparison: Comparison, path: Path, plots: Sequence[Path]
) -> Content:
    """The comparison as a run, metrics `<name>.<version>`; path: its comparison.json."""
    metrics = {
        f"{name}.{r.version}": value
        for r in comparison.versions
        for name, value in version_metrics(r).items()
    }
    params = {
        "study": study,
        "strategy": comparison.strategy,
        "scenarios": " ".join(comparison.scenarios),
    }
    params |= {
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
    metrics = {
        "failures": result.failures,
        "failures_by_ttc": result.modes.by_ttc,
        "tests": result.tests,
        "errors": result.errors,
    }
    metrics |= {
        f"failures.{scenario}": count for scenario, count in failures_by_scenario(result).items()
    }
    rates = {"failure_rate": result.rate}
    if result.paired is not None:
        rates |= {
            "p_value_against_base": result.paired.p_value,
            "change_against_base": float(result.change),
        }
        metrics |= {
            "fixes": len(result.paired.fixes),
            "regressions": len(result.paired.regressions),
        }
    return {**{name: float(value) for name, value in metrics.items()}, **rates}


def failures_by_scenario(result: VersionResult) -> dict[str, int]:
    """Failures of a version on each held-out scenario."""
    return {name: part.failures for name, part in result.scenarios.items()}


def registration_of(
    config: Config, card: ModelCard, path: Path, comparison: Comparison, plots: Sequence[Path]
) -> Registration:
    """A registered model version; path: its model.json, beside its other files."""
    result = next(r for r in comparison.versions if r.version == card.version)
    tags = {
        "study": config.study,
        "version": card.version,
        "failures": str(result.failures),
        "verdict": result.verdict,
    }
    return Registration(
        model=config.tracking.model_name,
        content=model_content(config, card, result, path, plots),
        files=[
            file
            for name in ("weights.safetensors", "model.onnx", "model.json")
            if (file := path.with_name(name)).exists()
        ],
        tags=tags,
    )


def model_content(
    config: Config, card: ModelCard, result: VersionResult, path: Path, plots: Sequence[Path]
) -> Content:
    """A model version as a run: parameters and curve of its training, its data, detection metrics and failures."""
    params = {
        "version": card.version,
        "parent": card.parent or "none",
        "parameters": str(card.parameters),
        "seed": str(card.seed),
    }
    params |= {"threshold": str(config.threshold), "iou": str(config.detector.get("iou", IOU))}
    params |= {f"training.{name}": str(value) for name, value in card.training.items()}
    tags: Mapping[str, str] = {
        WEIGHTS: card.weights_sha256,
        **{f"data.{name}": digest for name, digest in card.data.items()},
    }
    curve = path.with_name("curve.csv")
    points = read_curve(curve) if curve.exists() else []
    series = {
        f"training.{name}": [(point.iteration, getattr(point, name)) for point in points]
        for name in ("learning_rate", "loss_scores", "loss_boxes", "ap50")
        if points
    }
    shipped = card.parent is None and config.base.source == "shipped"
    sets = {
        "base_set": config.base.weights if shipped else f"data/{config.study}/base_set",
        "added": _added(config, card),
    }
    data = [
        DataSet(name, card.data[name], source, "training")
        for name, source in sets.items()
        if name in card.data
    ]
    results = version_metrics(result)
    return Content(
        f"{config.study}/{card.version}",
        "model",
        params,
        card.metrics,
        series,
        tags,
        data=data,
        pictures=plots,
        results=results,
    )


def _added(config: Config, card: ModelCard) -> str:
    """The folders of the images that a version was retrained on, beside the base set."""
    folders, arm = Folders(config), Version.named(card.version).arm
    if config.arms.get(arm) in (NEW_SCENES, BALANCED_SCENES):
        return f"{folders.root}/{folders.scenes(card.version, arm)}"
    later = card.training.get("round", 0) not in (0, 1)
    return f"{folders.root}/campaigns" + (f" {folders.root}/retrained/campaigns" if later else "")


def git_commit() -> str:
    """The commit of the working directory, "unknown" outside a repository."""
    try:
        done = subprocess.run(
            ["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        return "unknown"
    return done.stdout.strip() if done.returncode == 0 else "unknown"
