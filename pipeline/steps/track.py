"""Step `track`: logs a run per campaign and comparison, and a version per model, in MLflow."""

from __future__ import annotations

from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.results import read, write
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tracking_results import TrackedRun, TrackedStudy
from pipeline.config.schema import Config
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.tracking import ARTIFACTS, STORE, UNTRACKED


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    model_files: list[str] = []
    for name in ("weights.safetensors", "model.onnx", "curve.csv"):
        model_files += folders.models(name)
    return {
        "measures": f"{folders.root}/measures.json",
        "comparison": folders.compared["comparison"],
        "campaigns": [
            *folders.search("tests.parquet"),
            *folders.later_searches,
            *folders.held_out("tests.parquet"),
        ],
        "plots": folders.plots,
        "models": folders.models("model.json"),
        "model_files": model_files,
    }


STEP = Step(
    "Log everything to MLflow and register the model versions.",
    reads=_reads,
    writes=lambda folders: {"tracking": f"{folders.root}/tracking.json"},
    sections=tuple(name for name in Config.model_fields if name not in UNTRACKED),
    environment=("MLFLOW_TRACKING_URI",),
)


def run(job: Job) -> None:
    """Log the study and write tracking.json; logging it again changes nothing.

    Raises:
        InputError: MLflow fails.
    """
    from pipeline.tracking.client import usable

    with usable(STORE):
        tracked = _logged(job)
    write(job.output("tracking"), tracked)


def _logged(job: Job) -> TrackedStudy:
    """Log campaigns, comparison and models, and describe them with the verdict."""
    from pipeline.artefacts.model_card import read_card
    from pipeline.artefacts.tables import campaign_of, read_tests
    from pipeline.core.identity import CampaignId
    from pipeline.report.verdict import verdict_markdown, verdict_table
    from pipeline.tracking.champion import point_champion
    from pipeline.tracking.contents import (
        campaign_content,
        comparison_content,
        git_commit,
        registration_of,
        study_content,
    )
    from pipeline.tracking.registry import Registry
    from pipeline.tracking.runs import Tracker

    config, plots = job.config, job.inputs("plots")
    campaigns, models = job.inputs("campaigns"), job.inputs("models")
    model, experiment = config.tracking.model_name, config.tracking.experiment
    compared = read(job.input("comparison"), Comparison)
    measures = {}
    for row in read(job.input("measures"), Measures).campaigns:
        measures[CampaignId(row.scenario, row.strategy, row.version, row.seed)] = row
    tracker = Tracker(STORE, ARTIFACTS, experiment, {"mlflow.source.git.commit": git_commit()})
    registry = Registry(tracker)
    study = study_content(config)
    parent = tracker.log(study)
    contents, steps = [study], 2 + len(campaigns) + len(models)
    runs: dict[str, list[str]] = {}
    for done, path in enumerate(campaigns, 1):
        tests = read_tests(path)
        campaign = campaign_of(tests, path)
        contents.append(campaign_content(config.study, tests, measures.get(campaign), path))
        runs.setdefault(campaign.version, []).append(tracker.log(contents[-1], parent))
        job.progress(done, steps, contents[-1].name)
    contents.append(comparison_content(config.study, compared, job.input("comparison"), plots))
    compared_run = tracker.log(contents[-1], parent)
    versions, numbers, weights = [], {}, {}
    for done, path in enumerate(models, len(campaigns) + 2):
        card = read_card(path)
        registration = registration_of(config, card, path, compared, plots)
        number, run_id = registry.register(registration, parent)
        registry.link(model, number, runs.get(card.version, []))
        numbers[card.version], weights[card.version] = number, card.weights_sha256
        contents.append(registration.content)
        versions.append(run_id)
        job.progress(done, steps, registration.content.name)
    alias = point_champion(registry, model, compared, numbers, weights)
    job.progress(steps, steps, alias)
    sentence = f"{alias[0].upper()}{alias[1:]}.\n\n"
    table = verdict_table(compared, job.input("comparison").with_name("report.html"))
    for run_id in (parent, compared_run):
        tracker.describe(run_id, f"{sentence}```\n{table}\n```", versions)
    sentence = f"Study {config.study}. {sentence}"
    registry.describe(model, sentence + verdict_markdown(compared))
    for version, number in numbers.items():
        registry.set_alias(model, f"{config.study}-{version}", number)
        registry.describe(model, sentence + verdict_markdown(compared, version), number)
    return TrackedStudy(
        experiment=experiment,
        model=model,
        runs=tuple(TrackedRun(name=c.name, kind=c.kind, digest=c.digest) for c in contents),
        failures={result.version: result.failures for result in compared.versions},
        champion=compared.champion,
    )
