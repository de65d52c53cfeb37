"""The registered detector in MLflow: its versions, each with a logged model and a run, and their aliases.

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
    from mlflow.entities.model_registry import ModelVersion, RegisteredModel

ROOM = 5000
"""Longest description of a registered model or version, in characters."""
LIMITS = ("threshold", "iou")
"""Parameters of a run that the loaded model uses."""


@dataclass(frozen=True)
class Registration:
    """A model version: its registered name, its run, its files (an ONNX file makes it loadable by MLflow) and its tags."""

    model: str
    content: Content
    files: Sequence[Path]
    tags: Mapping[str, str]

    @property
    def digest(self) -> str:
        return hashlib.sha256(
            json.dumps([self.content.digest, [sha256(path) for path in self.files]]).encode()
        ).hexdigest()


class Registry:
    """The registered models in a tracker's store."""

    def __init__(self, tracker: Tracker) -> None:
        self._tracker = tracker
        self._client = tracker.client

    def register(self, registration: Registration, parent: str | None = None) -> tuple[str, str]:
        """Register the model version of a run unless it is registered already; returns its number and the run's id."""
        run_id = self._tracker.log(registration.content, parent)
        model, digest = registration.model, registration.digest
        known_models = self._logged_models(digest)
        if (known := self._version(model, run_id, known_models)) is not None:
            # A comparison's results are not part of a version's identity and may have changed.
            for name, value in registration.tags.items():
                self._client.set_model_version_tag(model, known.version, name, value)
            for logged in known_models:
                self._tracker.log_results(
                    run_id, registration.content, _newest(logged), logged.model_id
                )
            return str(known.version), run_id
        if not self._client.search_registered_models(f"name = '{model}'"):
            self._client.create_registered_model(
                model, description="Pedestrian detectors, tested in closed loop by Blindspot."
            )
        logged = self._logged_model(registration, run_id)
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
        return {
            name: str(number)
            for name, number in self._client.get_registered_model(model).aliases.items()
        }

    def run_tags(self, model: str, version: str) -> dict[str, str]:
        """The tags of a registered version's run; none if it has no run."""
        run_id = self._client.get_model_version(model, version).run_id
        return dict(self._client.get_run(run_id).data.tags) if run_id else {}

    def set_alias(self, model: str, alias: str, version: str) -> None:
        """Point an alias of the registered model at a version."""
        self._client.set_registered_model_alias(model, alias, version)

    def describe(self, model: str, text: str, version: str | None = None) -> None:
        """Set the description of a registered model or of one version of it, Markdown, cut to MLflow's limit."""
        if version is None:
            self._client.update_registered_model(model, shortened(text, ROOM))
        else:
            self._client.update_model_version(model, version, shortened(text, ROOM))

    def link(self, model: str, version: str, runs: Iterable[str]) -> None:
        """Name a model version in the runs of its campaigns."""
        for run_id in runs:
            self._client.set_tag(run_id, "model_version", f"{model}/{version}")

    def _logged_model(self, registration: Registration, run_id: str) -> Any:
        """The logged model of a registration; one that was killed is logged to its end."""
        from mlflow.entities import LoggedModelStatus, Metric

        content, digest = registration.content, registration.digest
        known = self._logged_models(digest)
        if ready := [found for found in known if found.status == LoggedModelStatus.READY]:
            return ready[0]
        logged = next(iter(known), None) or self._client.create_logged_model(
            self._tracker.experiment,
            name=content.name.replace("/", "-"),
            source_run_id=run_id,
            params=dict(content.params),
            tags={DIGEST: digest},
            model_type="detector",
        )
        with tempfile.TemporaryDirectory() as folder:
            for path in registration.files:
                if path.suffix == ".onnx":
                    save_served(
                        path,
                        Path(folder) / "model",
                        {name: float(content.params[name]) for name in LIMITS},
                    )
                    self._client.log_model_artifacts(logged.model_id, str(Path(folder) / "model"))
            for path in registration.files:
                if path.suffix != ".onnx":
                    self._client.log_model_artifact(logged.model_id, str(path))
        if points := content.metrics.items():
            self._client.log_batch(
                run_id, metrics=[Metric(*point, 1, 0, model_id=logged.model_id) for point in points]
            )
        self._tracker.log_results(run_id, content, _newest(logged), logged.model_id)
        return self._client.finalize_logged_model(logged.model_id, "READY")

    def _logged_models(self, digest: str) -> Sequence[LoggedModel]:
        found: Sequence[LoggedModel] = self._client.search_logged_models(
            [self._tracker.experiment], f"tags.`{DIGEST}` = '{digest}'"
        )
        return found

    def _version(
        self, model: str, run_id: str, logged: Sequence[LoggedModel]
    ) -> ModelVersion | None:
        sources = {one.artifact_location for one in logged}
        found = self._client.search_model_versions(f"name = '{model}' and run_id = '{run_id}'")
        return next((version for version in found if version.source in sources), None)


def _newest(logged: LoggedModel) -> dict[str, float]:
    """The newest value of each metric of a logged model."""
    return {
        metric.key: metric.value
        for metric in sorted(logged.metrics or [], key=lambda metric: metric.timestamp)
    }


def _pages(search: Callable[..., Any], **wanted: str) -> list[Any]:
    """All results of one of MLflow's searches, which return pages."""
    found, token = [], None
    while True:
        page = search(**wanted, page_token=token)
        found += page
        if not (token := page.token):
            return found


def registered(store: Path) -> list[dict[str, str]]:
    """The model versions that `register` made in a store, newest last: model, number, aliases, its own tags and the metrics of its run.

    Raises InputError if there is no store, or if MLflow cannot use it.
    """
    if server() is None and not store.is_file():
        raise InputError(
            f"{store.absolute()}: expected MLflow's database, found no file; the step track makes it"
        )
    with usable(store):
        client = connect(store)
        return [
            row for model in _pages(client.search_registered_models) for row in _rows(client, model)
        ]


def _rows(client: MlflowClient, model: RegisteredModel) -> list[dict[str, str]]:
    """A row for each of a model's versions."""
    aliases: dict[str, list[str]] = {}
    for alias, number in model.aliases.items():
        aliases.setdefault(str(number), []).append(alias)
    found = [
        v
        for v in _pages(client.search_model_versions, filter_string=f"name = '{model.name}'")
        if "study" in v.tags
    ]
    rows = []
    for version in sorted(found, key=lambda one: int(one.version)):
        number = str(version.version)
        metrics = {
            name: f"{value:g}"
            for name, value in client.get_run(version.run_id).data.metrics.items()
        }
        rows.append(
            {
                **metrics,
                **version.tags,
                "model": model.name,
                "number": number,
                "alias": ", ".join(sorted(aliases.get(number, []))),
            }
        )
    return rows
