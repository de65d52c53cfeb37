"""MLflow: runs, logged models and the registered detector. Nothing else imports mlflow.

Everything is logged under the digest of its content, so that tracking the same results twice leaves one run and one version. The store is
the server that MLFLOW_TRACKING_URI names, else an SQLite file of the project.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.artefacts.files import sha256
from pipeline.artefacts.results import RunKind
from pipeline.errors import InputError

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import LoggedModel, Run
    from mlflow.entities.model_registry import ModelVersion

DIGEST, PICTURES = "blindspot.digest", "blindspot.pictures"
PARENT = "mlflow.parentRunId"
DESCRIPTION = "mlflow.note.content"
KIND, TRAINING = "mlflow.experimentKind", "custom_model_development"
"""Tells MLflow's page to show an experiment as model training, not as generative AI."""
BATCH, PARAMS = 900, 100
"""Metrics and parameters a request; MLflow takes at most 1,000 and 100."""
ROOM = 8000
"""Characters of a tag's value at most."""


@dataclass(frozen=True)
class DataSet:
    """Data that a run used. context: what for, such as `training`; source: where it lies."""

    name: str
    digest: str
    source: str
    context: str


@dataclass(frozen=True)
class Content:
    """What a run holds. series: name -> (step, value) pairs. files: logged at the top of the run's artifacts.

    pictures and results, metrics that a later comparison gives it, are logged beside them, but are no part of what it is: drawn or compared
    anew it is no other run.
    """

    name: str
    kind: RunKind
    params: Mapping[str, str] = field(default_factory=dict)
    metrics: Mapping[str, float] = field(default_factory=dict)
    series: Mapping[str, Sequence[tuple[int, float]]] = field(default_factory=dict)
    tags: Mapping[str, str] = field(default_factory=dict)
    files: Sequence[Path] = ()
    data: Sequence[DataSet] = ()
    pictures: Sequence[Path] = ()
    results: Mapping[str, float] = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """SHA-256 of all but the pictures and results, the files' bytes included; paths and times do not count."""
        plain = {key: value for key, value in asdict(self).items() if key not in ("files", "pictures", "results")}
        plain["files"] = _named_digests(self.files)
        return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class Registration:
    """A model version: its registered name, the run behind it, its own files (an ONNX file makes it loadable by MLflow), tags and text."""

    model: str
    content: Content
    files: Sequence[Path]
    tags: Mapping[str, str]
    description: str

    @property
    def digest(self) -> str:
        return hashlib.sha256(json.dumps([self.content.digest, [sha256(path) for path in self.files]]).encode()).hexdigest()


class Tracker:
    """One experiment. Makes store, artifacts and experiment if they are not there."""

    def __init__(self, store: Path, artifacts: Path, experiment: str, lineage: Mapping[str, str]) -> None:
        """store: SQLite file, and artifacts: folder, where no server is named. lineage: tags on every new run that are no part of its
        content, such as the git commit.
        """
        from mlflow.exceptions import MlflowException

        server = os.environ.get("MLFLOW_TRACKING_URI")
        if server is None:
            store.parent.mkdir(parents=True, exist_ok=True)
            artifacts.mkdir(parents=True, exist_ok=True)
        self._client = _client(store)
        self._lineage = dict(lineage)
        place = None if server else (artifacts.resolve() / experiment).as_uri()
        try:
            known = self._client.get_experiment_by_name(experiment)
            if known is not None and known.lifecycle_stage == "deleted":
                raise InputError(f"MLflow's experiment '{experiment}' is deleted; restore it, or name another as tracking.experiment")
            self._experiment = str(
                known.experiment_id if known else self._client.create_experiment(experiment, place, tags={KIND: TRAINING})
            )
        except MlflowException as error:
            raise InputError(f"MLflow at {server or store} cannot be used: {str(error).splitlines()[0]}") from error

    def log(self, content: Content, parent: str | None = None) -> str:
        """Log a run unless one of the same name and content is there; returns its id.

        parent: id of the run that it is shown under. A run that is there moves under it.
        """
        digest = content.digest
        if (known := self._finished(content.name, digest)) is not None:
            if parent is not None and known.data.tags.get(PARENT) != parent:
                self._client.set_tag(known.info.run_id, PARENT, parent)
            self._log_pictures(known.info.run_id, content, known.data.tags.get(PICTURES, ""))
            self._log_results(known.info.run_id, content, known.data.metrics)
            return str(known.info.run_id)
        tags = {**self._lineage, **content.tags, DIGEST: digest, "kind": content.kind} | ({} if parent is None else {PARENT: parent})
        run_id = str(self._client.create_run(self._experiment, run_name=content.name, tags=tags).info.run_id)
        self._log_numbers(run_id, content)
        if content.data:
            self._client.log_inputs(run_id, [_dataset(data) for data in content.data])
        for path in content.files:
            self._client.log_artifact(run_id, str(path))
        self._log_pictures(run_id, content)
        self._client.set_terminated(run_id)
        return run_id

    def register(self, registration: Registration, parent: str | None = None) -> tuple[str, str]:
        """Register a model version behind a run, unless the same is registered; returns its number and the run's id."""
        run_id = self.log(registration.content, parent)
        model, digest = registration.model, registration.digest
        if (known := self._version(model, digest)) is not None:
            # What a comparison says of it, its gate or its level, is no part of what it is, and may have changed.
            for name, value in registration.tags.items():
                self._client.set_model_version_tag(model, known.version, name, value)
            self._client.update_model_version(model, known.version, registration.description)
            for logged in self._logged_models(digest):
                newest = {metric.key: metric.value for metric in sorted(logged.metrics or [], key=lambda metric: metric.timestamp)}
                self._log_results(run_id, registration.content, newest, logged.model_id)
            return str(known.version), run_id
        if not self._client.search_registered_models(f"name = '{model}'"):
            self._client.create_registered_model(model, description="Pedestrian detectors, tested in closed loop by Blindspot.")
        logged = self._logged_model(registration, run_id)
        version = self._client.create_model_version(
            model,
            logged.artifact_location,
            run_id,
            tags={**registration.tags, DIGEST: digest},
            description=registration.description,
            model_id=logged.model_id,
        )
        return str(version.version), run_id

    def aliases(self, model: str) -> dict[str, str]:
        """The aliases of a registered model, each with the number of its version."""
        return {name: str(number) for name, number in self._client.get_registered_model(model).aliases.items()}

    def tags(self, model: str, version: str) -> dict[str, str]:
        """The tags of a registered version."""
        return dict(self._client.get_model_version(model, version).tags)

    def set_alias(self, model: str, alias: str, version: str) -> None:
        """Point an alias of the registered model at a version."""
        self._client.set_registered_model_alias(model, alias, version)

    def link(self, model: str, version: str, runs: Mapping[str, str]) -> None:
        """Tie a model version to the runs of its campaigns, in both directions. runs: id -> name."""
        self._client.set_model_version_tag(model, version, "campaigns", " ".join(sorted(runs.values())))
        self._client.set_model_version_tag(model, version, "campaign_runs", " ".join(sorted(runs)))
        for run_id in runs:
            self._client.set_tag(run_id, "model_version", f"{model}/{version}")

    def describe(self, run_id: str, text: str, compared: Sequence[str] = ()) -> None:
        """Set a run's description, Markdown, cut to what MLflow takes, with a link that opens MLflow's comparison of some runs."""
        if compared:
            ids = ",".join(f"%22{run}%22" for run in compared)
            text = f"[Compare the versions](#/compare-runs?runs=[{ids}]&experiments=[%22{self._experiment}%22])\n\n{text}"
        if len(text) > ROOM:
            cut = text[: ROOM - 100].rpartition("\n")[0]
            text = cut + ("\n```" if cut.count("```") % 2 else "") + "\n\nThe rest is in the report."
        self._client.set_tag(run_id, DESCRIPTION, text)

    def _logged_model(self, registration: Registration, run_id: str) -> Any:
        """The logged model of a registration; one whose making was cut off is deleted."""
        from mlflow.entities import LoggedModelStatus, Metric

        content, digest = registration.content, registration.digest
        for found in self._logged_models(digest):
            if found.status == LoggedModelStatus.READY:
                return found
            self._client.delete_logged_model(found.model_id)
        logged = self._client.create_logged_model(
            self._experiment,
            name=content.name.replace("/", "-"),
            source_run_id=run_id,
            params=dict(content.params),
            tags={DIGEST: digest},
            model_type="detector",
        )
        with tempfile.TemporaryDirectory() as folder:
            for path in registration.files:
                if path.suffix == ".onnx":
                    _save_flavour(path, Path(folder) / "model")
                    self._client.log_model_artifacts(logged.model_id, str(Path(folder) / "model"))
            for path in registration.files:
                if path.suffix != ".onnx":
                    self._client.log_model_artifact(logged.model_id, str(path))
        points = {**content.metrics, **content.results}.items()
        self._client.log_batch(run_id, metrics=[Metric(*point, 1, 0, model_id=logged.model_id) for point in points])
        return self._client.finalize_logged_model(logged.model_id, "READY")

    def _logged_models(self, digest: str) -> Sequence[LoggedModel]:
        found: Sequence[LoggedModel] = self._client.search_logged_models([self._experiment], f"tags.`{DIGEST}` = '{digest}'")
        return found

    def _log_pictures(self, run_id: str, content: Content, logged: str = "") -> None:
        """logged: the digest of those that the run has."""
        digest = hashlib.sha256(json.dumps(_named_digests(content.pictures)).encode()).hexdigest()
        if content.pictures and digest != logged:
            for path in content.pictures:
                self._client.log_artifact(run_id, str(path))
            self._client.set_tag(run_id, PICTURES, digest)

    def _log_results(self, run_id: str, content: Content, logged: Mapping[str, float], model_id: str | None = None) -> None:
        """Those that are others than a run, or a logged model of it, has; MLflow shows the newest."""
        from mlflow.entities import Metric

        now = time.time_ns() // 1_000_000
        changed = [Metric(*point, now, 0, model_id=model_id) for point in content.results.items() if logged.get(point[0]) != point[1]]
        if changed:
            self._client.log_batch(run_id, metrics=changed)

    def _log_numbers(self, run_id: str, content: Content) -> None:
        from mlflow.entities import Metric, Param

        # A fixed time: what was measured has none of its own, and the steps order a series.
        points = [Metric(name, float(value), 0, 0) for name, value in {**content.metrics, **content.results}.items()]
        points += [Metric(name, float(value), 0, step) for name, values in content.series.items() for step, value in values]
        params = [Param(name, value) for name, value in content.params.items()]
        for begin in range(0, len(params), PARAMS):
            self._client.log_batch(run_id, params=params[begin : begin + PARAMS])
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


def _named_digests(paths: Sequence[Path]) -> list[tuple[str, str]]:
    return sorted((path.name, sha256(path)) for path in paths)


def _client(store: Path) -> MlflowClient:
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = "true"
    os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
    os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")
    # A server that does not answer is an error after seconds, not after MLflow's minutes.
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "3")
    from mlflow import MlflowClient

    # The store's migrations tell about themselves, a hundred lines on first use.
    logging.getLogger("alembic").setLevel(logging.WARNING)
    uri = os.environ.get("MLFLOW_TRACKING_URI") or f"sqlite:///{store.resolve()}"
    return MlflowClient(tracking_uri=uri, registry_uri=uri)


def _dataset(data: DataSet) -> Any:
    from mlflow.entities import Dataset, DatasetInput, InputTag

    described = Dataset(data.name, data.digest[:32], "local", json.dumps({"uri": data.source}))
    return DatasetInput(described, [InputTag("mlflow.data.context", data.context)])


def _save_flavour(onnx_file: Path, folder: Path) -> None:
    """Write an ONNX file as MLflow's onnx model, with the signature that its inputs and outputs give."""
    import mlflow.onnx
    import onnx
    from mlflow.models import ModelSignature
    from mlflow.types import Schema, TensorSpec

    model = onnx.load(str(onnx_file))

    def schema(values: Any) -> Schema:
        specs = []
        for value in values:
            tensor = value.type.tensor_type
            shape = tuple(side.dim_value if side.HasField("dim_value") else -1 for side in tensor.shape.dim)
            specs.append(TensorSpec(np.dtype(onnx.helper.tensor_dtype_to_np_dtype(tensor.elem_type)), shape, value.name))
        return Schema(specs)

    signature = ModelSignature(inputs=schema(model.graph.input), outputs=schema(model.graph.output))
    # Named here, because MLflow would try the model in a process of its own to find them.
    mlflow.onnx.save_model(model, folder, signature=signature, pip_requirements=["onnx", "onnxruntime", "numpy"])


def _pages(search: Callable[..., Any], **wanted: str) -> list[Any]:
    """Everything that one of MLflow's searches finds; it gives a page at a time."""
    found, token = [], None
    while True:
        page = search(**wanted, page_token=token)
        found += page
        if not (token := page.token):
            return found


def registered(store: Path) -> list[dict[str, str]]:
    """The model versions of a store that `register` made, newest last: model, number, aliases, and the tags that it gave.

    Raises InputError if there is no store.
    """
    from mlflow.exceptions import MlflowException

    if "MLFLOW_TRACKING_URI" not in os.environ and not store.is_file():
        raise InputError(f"{store}: expected MLflow's database, found no file; it is made by the step track")
    client = _client(store)
    rows = []
    try:
        models = _pages(client.search_registered_models)
    except MlflowException as error:
        raise InputError(
            f"MLflow at {os.environ.get('MLFLOW_TRACKING_URI', store)} cannot be used: {str(error).splitlines()[0]}"
        ) from error
    for model in models:
        aliases: dict[str, list[str]] = {}
        for alias, number in model.aliases.items():
            aliases.setdefault(str(number), []).append(alias)
        found = [v for v in _pages(client.search_model_versions, filter_string=f"name = '{model.name}'") if DIGEST in v.tags]
        for version in sorted(found, key=lambda one: int(one.version)):
            number = str(version.version)
            rows.append({"model": model.name, "number": number, "alias": ", ".join(aliases.get(number, [])), **version.tags})
    return rows
