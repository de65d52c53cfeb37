"""The registered detector in MLflow: versions, each with a logged model and a run, and aliases.

A version's logged model has the digest of its content, so registering it twice makes one version.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.artefacts.files import sha256
from pipeline.errors import InputError
from pipeline.tracking.client import connect, server, usable
from pipeline.tracking.runs import DIGEST, Content, Tracker, shortened
from pipeline.tracking.served_model import save_served

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import LoggedModel
    from mlflow.entities.model_registry import RegisteredModel

ROOM = 5000
"""Longest description of a registered model or version, in characters."""
LIMITS = ("threshold", "iou")
"""Parameters of a run that the loaded model uses."""


@dataclass(frozen=True)
class Registration:
    """A model version.

    Attributes:
        model: Name of the registered model.
        content: Content of the version's run.
        files: Its files; an ONNX file makes it loadable by MLflow.
        tags: Its tags.
    """

    model: str
    content: Content
    files: Sequence[Path]
    tags: Mapping[str, str]

    @property
    def digest(self) -> str:
        """SHA-256 of the content and the files."""
        plain = [self.content.digest, [sha256(path) for path in self.files]]
        return hashlib.sha256(json.dumps(plain).encode()).hexdigest()


class Registry:
    """The registered models in a tracker's store."""

    def __init__(self, tracker: Tracker) -> None:
        self._tracker = tracker
        self._client = tracker.client

    def register(self, registration: Registration, parent: str | None = None) -> tuple[str, str]:
        """Register the model version of a run unless it is registered already.

        Args:
            registration: The model version.
            parent: Id of the parent run.

        Returns:
            The number of the version, and the id of its run.
        """
        content, model = registration.content, registration.model
        run_id = self._tracker.log(content, parent)
        query = f"tags.`{DIGEST}` = '{registration.digest}'"
        logged_models = self._client.search_logged_models([self._tracker.experiment], query)
        sources = {logged.artifact_location for logged in logged_models}
        versions = self._client.search_model_versions(f"name = '{model}' and run_id = '{run_id}'")
        for version in versions:
            if version.source not in sources:
                continue
            # A comparison's results are not part of a version's identity and may have changed.
            for name, value in registration.tags.items():
                self._client.set_model_version_tag(model, version.version, name, value)
            for logged in logged_models:
                metrics = _newest(logged)
                self._tracker.log_results(run_id, content, metrics, logged.model_id)
            return str(version.version), run_id
        if not self._client.search_registered_models(f"name = '{model}'"):
            text = "Pedestrian detectors, tested in closed loop by Blindspot."
            self._client.create_registered_model(model, description=text)
        logged = self._logged_model(registration, run_id, logged_models)
        version = self._client.create_model_version(
            model,
            logged.artifact_location,
            run_id,
            tags=dict(registration.tags),
            model_id=logged.model_id,
        )
        return str(version.version), run_id

    def aliases(self, model: str) -> dict[str, str]:
        """The aliases of a registered model, each with the number of its version."""
        aliases = self._client.get_registered_model(model).aliases
        return {name: str(number) for name, number in aliases.items()}

    def run_tags(self, model: str, version: str) -> dict[str, str]:
        """The tags of a registered version's run; empty if it has no run."""
        run_id = self._client.get_model_version(model, version).run_id
        return dict(self._client.get_run(run_id).data.tags) if run_id else {}

    def set_alias(self, model: str, alias: str, version: str) -> None:
        """Point an alias of the registered model at a version."""
        self._client.set_registered_model_alias(model, alias, version)

    def describe(self, model: str, text: str, version: str | None = None) -> None:
        """Set the description of a registered model or of one of its versions.

        Args:
            model: Name of the registered model.
            text: Markdown; it is cut to MLflow's limit.
            version: Number of the version; None describes the model.
        """
        if version is None:
            self._client.update_registered_model(model, shortened(text, ROOM))
        else:
            self._client.update_model_version(model, version, shortened(text, ROOM))

    def link(self, model: str, version: str, runs: Iterable[str]) -> None:
        """Tag the runs of a version's campaigns with the version."""
        for run_id in runs:
            self._client.set_tag(run_id, "model_version", f"{model}/{version}")

    def _logged_model(
        self, registration: Registration, run_id: str, existing: Sequence[LoggedModel]
    ) -> Any:
        """The logged model of a registration; one that was killed is logged to its end.

        existing: logged models of the same digest.
        """
        from mlflow.entities import LoggedModelStatus, Metric

        content = registration.content
        for logged in existing:
            if logged.status == LoggedModelStatus.READY:
                return logged
        logged = next(iter(existing), None) or self._client.create_logged_model(
            self._tracker.experiment,
            name=content.name.replace("/", "-"),
            source_run_id=run_id,
            params=dict(content.params),
            tags={DIGEST: registration.digest},
            model_type="detector",
        )
        with tempfile.TemporaryDirectory() as folder:
            for path in registration.files:
                if path.suffix == ".onnx":
                    limits = {name: float(content.params[name]) for name in LIMITS}
                    save_served(path, Path(folder) / "model", limits)
                    self._client.log_model_artifacts(logged.model_id, str(Path(folder) / "model"))
            for path in registration.files:
                if path.suffix != ".onnx":
                    self._client.log_model_artifact(logged.model_id, str(path))
        if points := content.metrics.items():
            metrics = [Metric(*point, 1, 0, model_id=logged.model_id) for point in points]
            self._client.log_batch(run_id, metrics=metrics)
        self._tracker.log_results(run_id, content, _newest(logged), logged.model_id)
        return self._client.finalize_logged_model(logged.model_id, "READY")


def _newest(logged: LoggedModel) -> dict[str, float]:
    """The newest value of each metric of a logged model."""
    metrics = sorted(logged.metrics or [], key=lambda metric: metric.timestamp)
    return {metric.key: metric.value for metric in metrics}


def _pages(search: Callable[..., Any], **wanted: str) -> list[Any]:
    """All results of one of MLflow's searches, which return pages."""
    results, token = [], None
    while True:
        page = search(**wanted, page_token=token)
        results += page
        if not (token := page.token):
            return results


def registered(store: Path) -> list[dict[str, str]]:
    """The model versions that `register` made in a store, newest last.

    Args:
        store: SQLite file of the runs, without a server.

    Returns:
        A row for each version: model, number, aliases, its tags and the metrics of its run.

    Raises:
        InputError: There is no store, or MLflow cannot use it.
    """
    if server() is None and not store.is_file():
        raise InputError(
            f"{store.absolute()}: expected MLflow's database, found no file; the step track makes "
            "it"
        )
    rows: list[dict[str, str]] = []
    with usable(store):
        client = connect(store)
        for model in _pages(client.search_registered_models):
            rows += _rows(client, model)
    return rows


def _rows(client: MlflowClient, model: RegisteredModel) -> list[dict[str, str]]:
    """A row for each of a model's versions."""
    aliases: dict[str, list[str]] = {}
    for alias, number in model.aliases.items():
        aliases.setdefault(str(number), []).append(alias)
    rows = []
    versions = _pages(client.search_model_versions, filter_string=f"name = '{model.name}'")
    for version in sorted(versions, key=lambda version: int(version.version)):
        if "study" not in version.tags:
            continue
        number, metrics = str(version.version), client.get_run(version.run_id).data.metrics
        alias = ", ".join(sorted(aliases.get(number, [])))
        identity = {"model": model.name, "number": number, "alias": alias}
        numbers = {name: f"{value:g}" for name, value in metrics.items()}
        rows.append({**numbers, **version.tags, **identity})
    return rows
