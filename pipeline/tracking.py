"""MLflow: runs, logged models and the registered detector. Nothing else imports mlflow.

Everything is logged under the digest of its content, so that tracking the same results twice leaves one run and one version.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.artefacts.files import sha256
from pipeline.artefacts.results import RunKind
from pipeline.protocols import InputError

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Run
    from mlflow.entities.model_registry import ModelVersion

DIGEST = "blindspot.digest"
BATCH = 900
"""Metrics a request; MLflow takes at most 1,000."""


@dataclass(frozen=True)
class Content:
    """What a run holds. series: name -> values at steps 1, 2, ... files: logged under `folder`."""

    name: str
    kind: RunKind
    params: Mapping[str, str] = field(default_factory=dict)
    metrics: Mapping[str, float] = field(default_factory=dict)
    series: Mapping[str, Sequence[float]] = field(default_factory=dict)
    tags: Mapping[str, str] = field(default_factory=dict)
    files: Sequence[Path] = ()

    @property
    def digest(self) -> str:
        """SHA-256 of all of it, the files' bytes included; paths and times do not count."""
        plain = {key: value for key, value in asdict(self).items() if key != "files"}
        plain["files"] = sorted((path.name, sha256(path)) for path in self.files)
        return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


class Tracker:
    """One experiment in an SQLite store with artifacts in a folder. Makes both if they are not there."""

    def __init__(self, store: Path, artifacts: Path, experiment: str, lineage: Mapping[str, str]) -> None:
        """lineage: tags on every new run that are not part of its content, such as the git commit."""
        os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"
        os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
        from mlflow import MlflowClient

        # The store's migrations tell about themselves, a hundred lines on first use.
        logging.getLogger("alembic").setLevel(logging.WARNING)
        store.parent.mkdir(parents=True, exist_ok=True)
        artifacts.mkdir(parents=True, exist_ok=True)
        uri = f"sqlite:///{store.resolve()}"
        self._client: MlflowClient = MlflowClient(tracking_uri=uri, registry_uri=uri)
        self._lineage = dict(lineage)
        known = self._client.get_experiment_by_name(experiment)
        self._experiment: str = (
            known.experiment_id if known else self._client.create_experiment(experiment, (artifacts.resolve() / experiment).as_uri())
        )

    def log(self, content: Content) -> str:
        """Log a run unless one of the same name and content is there; returns its id."""
        digest = content.digest
        if (known := self._finished(content.name, digest)) is not None:
            return str(known.info.run_id)
        tags = {**self._lineage, **content.tags, DIGEST: digest, "kind": content.kind}
        run_id = str(self._client.create_run(self._experiment, run_name=content.name, tags=tags).info.run_id)
        self._log_numbers(run_id, content)
        for path in content.files:
            self._client.log_artifact(run_id, str(path))
        self._client.set_terminated(run_id)
        return run_id

    def register(self, model: str, content: Content, files: Sequence[Path], tags: Mapping[str, str], description: str) -> str:
        """Register a model version behind a run of `content`, unless the same is registered; returns its number.

        model: registered name. files: the model's own files. tags: on the version; a registry in SQLite shows no metrics.
        """
        from mlflow.entities import Metric

        run_id = self.log(content)
        digest = hashlib.sha256(json.dumps([content.digest, [sha256(path) for path in files]]).encode()).hexdigest()
        if (known := self._version(model, digest)) is not None:
            return str(known.version)
        if not self._client.search_registered_models(f"name = '{model}'"):
            self._client.create_registered_model(model, description="Pedestrian detectors, tested in closed loop by Blindspot.")
        logged = self._client.create_logged_model(
            self._experiment, name=content.name.replace("/", "-"), source_run_id=run_id, params=dict(content.params), model_type="detector"
        )
        for path in files:
            self._client.log_model_artifact(logged.model_id, str(path))
        self._client.log_batch(run_id, metrics=[Metric(*point, 1, 0, model_id=logged.model_id) for point in content.metrics.items()])
        self._client.finalize_logged_model(logged.model_id, "READY")
        version = self._client.create_model_version(
            model,
            logged.artifact_location,
            run_id,
            tags={**tags, DIGEST: digest},
            description=description,
            model_id=logged.model_id,
        )
        return str(version.version)

    def set_alias(self, model: str, alias: str, version: str) -> None:
        """Point an alias of the registered model at a version."""
        self._client.set_registered_model_alias(model, alias, version)

    def _log_numbers(self, run_id: str, content: Content) -> None:
        from mlflow.entities import Metric, Param

        # A fixed time: what was measured has none of its own, and the steps order a series.
        points = [Metric(name, float(value), 0, 0) for name, value in content.metrics.items()]
        points += [Metric(name, float(v), 0, step) for name, values in content.series.items() for step, v in enumerate(values, 1)]
        self._client.log_batch(run_id, params=[Param(name, value) for name, value in content.params.items()])
        for begin in range(0, len(points), BATCH):
            self._client.log_batch(run_id, metrics=points[begin : begin + BATCH])

    def _finished(self, name: str, digest: str) -> Run | None:
        """The finished run of this name and content; one that was cut off is deleted."""
        runs = self._client.search_runs([self._experiment], f"tags.`{DIGEST}` = '{digest}' and attributes.run_name = '{name}'")
        for run in runs:
            if run.info.status == "FINISHED":
                return run
            self._client.delete_run(run.info.run_id)
        return None

    def _version(self, model: str, digest: str) -> ModelVersion | None:
        found = self._client.search_model_versions(f"name = '{model}' and tags.`{DIGEST}` = '{digest}'")
        return found[0] if found else None


def registered(store: Path) -> list[dict[str, str]]:
    """The registered model versions of a store, newest last: model, number, aliases, and the tags that `register` gave.

    Raises InputError if there is no store.
    """
    if not store.is_file():
        raise InputError(f"{store}: expected MLflow's database, found no file; it is made by the step track")
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"
    from mlflow import MlflowClient

    logging.getLogger("alembic").setLevel(logging.WARNING)
    uri = f"sqlite:///{store.resolve()}"
    client = MlflowClient(tracking_uri=uri, registry_uri=uri)
    rows = []
    for model in client.search_registered_models():
        aliases: dict[str, list[str]] = {}
        for alias, number in model.aliases.items():
            aliases.setdefault(str(number), []).append(alias)
        for version in sorted(client.search_model_versions(f"name = '{model.name}'"), key=lambda found: int(found.version)):
            number = str(version.version)
            rows.append({"model": model.name, "number": number, "alias": ", ".join(aliases.get(number, [])), **version.tags})
    return rows
