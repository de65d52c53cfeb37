"""Step `track`: a run per campaign and comparison, and a registered version per model, in MLflow."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from pipeline.artefacts.campaign import read_tests
from pipeline.artefacts.model import ModelCard, read_card
from pipeline.artefacts.results import CampaignMeasures, Comparison, Measures, TrackedRun, Tracking, VersionResult, read, write
from pipeline.config import Config
from pipeline.core.measures import failure_sequence
from pipeline.steps.measure import campaign_key, count_modes
from pipeline.tracking import Content, Tracker

Progress = Callable[[int, int, str], None]


def run(
    config: Config,
    *,
    models: Sequence[Path],
    measures: Path,
    comparison: Path,
    campaigns: Sequence[Path],
    plots: Sequence[Path],
    store: Path,
    artifacts: Path,
    out: Path,
    progress: Progress,
) -> None:
    """Log the study and write tracking.json; logging it again changes nothing.

    models: model.json of each version, its other files beside it. campaigns: tests.parquet of the search and of the comparison.
    plots: PNGs, logged with the comparison and with each version. store: SQLite file. artifacts: folder.
    """
    measured, compared = read(measures, Measures), read(comparison, Comparison)
    by_campaign = {(c.scenario, c.strategy, c.version, c.seed): c for c in measured.campaigns}
    contents = []
    for path in campaigns:
        tests = read_tests(path)
        contents.append(campaign_content(config.study, tests, by_campaign.get(campaign_key(tests, path)), path))
    contents.append(comparison_content(config.study, compared, plots))
    tracker = Tracker(store, artifacts, config.tracking.experiment, {"mlflow.source.git.commit": git_commit()})
    steps = len(contents) + len(models)
    for done, content in enumerate(contents, 1):
        tracker.log(content)
        progress(done, steps, content.name)
    for done, path in enumerate(models, len(contents) + 1):
        content = _register(tracker, config, read_card(path), path, compared, plots)
        contents.append(content)
        progress(done, steps, content.name)
    runs = tuple(TrackedRun(name=c.name, kind=c.kind, digest=c.digest) for c in contents)
    failures = {result.version: result.failures for result in compared.versions}
    name = config.tracking.model_name
    write(out, Tracking(experiment=config.tracking.experiment, model=name, runs=runs, failures=failures, champion=compared.champion))


def campaign_content(study: str, tests: pd.DataFrame, measured: CampaignMeasures | None, path: Path) -> Content:
    """One campaign as a run: failures by mode, Θ as a series, the measures if it was a search, the table itself."""
    scenario, strategy, version, seed = campaign_key(tests, path)
    theta = failure_sequence(tests.sort_values("index")["failure"].to_numpy(bool))
    modes = count_modes(tests)
    metrics = {"tests": len(tests), "errors": int((tests["status"] != "ok").sum()), "failures": modes.total}
    metrics |= {"failures_by_ttc": modes.by_ttc, **{f"failures_{mode}": count for mode, count in modes}}
    if measured is not None:
        names = ("f_measure", "f_n", "c_measure", "pair_coverage_tests", "pair_coverage_failures", "projection_coverage")
        metrics |= {name: value for name in names if (value := getattr(measured, name)) is not None}
    return Content(
        name=f"{study}/{scenario}/{strategy}/{version}/{seed}",
        kind="campaign",
        params={"study": study, "scenario": scenario, "strategy": strategy, "version": version, "seed": str(seed)},
        metrics={name: float(value) for name, value in metrics.items()},
        series={"failures_found": [float(count) for count in theta]},
        files=[path],
    )


def comparison_content(study: str, comparison: Comparison, plots: Sequence[Path]) -> Content:
    """The comparison as a run, metrics `<name>.<version>`."""
    metrics = {f"{name}.{r.version}": value for r in comparison.versions for name, value in version_metrics(r).items()}
    params = {"study": study, "strategy": comparison.strategy, "scenarios": " ".join(comparison.scenarios)}
    params |= {"sequence": comparison.sequence_digest[:16], "alpha": str(comparison.alpha), "champion": comparison.champion}
    return Content(name=f"{study}/comparison", kind="comparison", params=params, metrics=metrics, files=plots)


def version_metrics(result: VersionResult) -> dict[str, float]:
    """A version's numbers on the held-out sequence; `failures.<scenario>` beside the total."""
    metrics = {"failures": result.failures, "failures_by_ttc": result.modes.by_ttc, "tests": result.tests, "errors": result.errors}
    metrics |= {f"failures.{scenario}": count for scenario, count in failures_by_scenario(result).items()}
    rates = {"failure_rate": result.rate.value}
    if result.paired is not None:
        rates |= {"p_value_against_base": result.paired.p_value, "change_against_base": float(result.change)}
        metrics |= {"fixes": len(result.paired.fixes), "regressions": len(result.paired.regressions)}
    return {**{name: float(value) for name, value in metrics.items()}, **rates}


def failures_by_scenario(result: VersionResult) -> dict[str, int]:
    """Failures of a version on each held-out scenario."""
    return {name: part.failures for name, part in result.scenarios.items()}


def _register(tracker: Tracker, config: Config, card: ModelCard, path: Path, comparison: Comparison, plots: Sequence[Path]) -> Content:
    result = next(r for r in comparison.versions if r.version == card.version)
    content = model_content(config.study, card, result, plots)
    tags = {"study": config.study, "version": card.version, "verdict": result.verdict, "failures": str(result.failures)}
    tags |= {"gate": comparison.gate[card.version]}
    tags |= {"failures_by_ttc": str(result.modes.by_ttc), "tests": str(result.tests)}
    tags |= {f"failures.{scenario}": str(count) for scenario, count in failures_by_scenario(result).items()}
    files = [file for name in ("weights.safetensors", "model.onnx", "model.json") if (file := path.with_name(name)).exists()]
    text = f"{card.version} of study {config.study}: {result.failures} failures in {result.tests} held-out tests ({result.verdict})."
    number = tracker.register(config.tracking.model_name, content, files, tags, text)
    if card.version == comparison.champion:
        tracker.set_alias(config.tracking.model_name, "champion", number)
    return content


def model_content(study: str, card: ModelCard, result: VersionResult, plots: Sequence[Path]) -> Content:
    """A model version as a run: parameters of its training, lineage, detection metrics and failures."""
    params = {"version": card.version, "parent": card.parent or "none", "parameters": str(card.parameters), "seed": str(card.seed)}
    params |= {f"training.{name}": str(value) for name, value in card.training.items()}
    tags: Mapping[str, str] = {"weights_sha256": card.weights_sha256, **{f"data.{name}": digest for name, digest in card.data.items()}}
    metrics = {**card.metrics, **version_metrics(result)}
    return Content(f"{study}/{card.version}", "model", params, metrics, {}, tags, plots)


def git_commit() -> str:
    """The commit of the working directory, "unknown" outside a repository."""
    try:
        done = subprocess.run(["git", "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return "unknown"
    return done.stdout.strip() if done.returncode == 0 else "unknown"
