"""Runs in MLflow.

A run is logged under the digest of its content, so tracking the same results twice makes one run.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.artefacts.files import sha256
from pipeline.artefacts.tracking_results import RunKind
from pipeline.errors import InputError
from pipeline.tracking.client import connect, server

if TYPE_CHECKING:
    from mlflow.entities import Run

DIGEST, PICTURES = "blindspot.digest", "blindspot.pictures"
PARENT = "mlflow.parentRunId"
DESCRIPTION = "mlflow.note.content"
KIND, TRAINING = "mlflow.experimentKind", "custom_model_development"
"""Tag that makes MLflow's page show an experiment as model training, not as generative AI."""
FINISHED = "FINISHED"
BATCH, PARAMS = 900, 100
"""Metrics and parameters per request; MLflow takes at most 1,000 and 100."""
ROOM = 8000
"""Longest value of a tag, in characters."""


@dataclass(frozen=True)
class DataSet:
    """Data that a run used. context: its purpose, such as `training`; source: its location."""

    name: str
    digest: str
    source: str
    context: str


@dataclass(frozen=True)
class Content:
    """The content of a run. series: name -> (step, value) pairs. files: logged at the top of the run's artifacts.

    pictures and results (metrics that a later comparison adds) are logged beside the content but do not belong to it: redrawing or
    comparing again makes no new run.
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
        """SHA-256 of everything but the pictures and results, including the files' bytes; excludes paths and times."""
        plain = {
            key: value
            for key, value in asdict(self).items()
            if key not in ("files", "pictures", "results")
        }
        plain["files"] = _named_digests(self.files)
        return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


class Tracker:
    """One experiment. Creates store, artifacts and experiment if they are missing."""

    def __init__(
        self, store: Path, artifacts: Path, experiment: str, lineage: Mapping[str, str]
    ) -> None:
        """store: SQLite file, and artifacts: folder, if no server is named. lineage: tags on every new run that are not part of its
        content, such as the git commit."""
        if server() is None:
            artifacts.mkdir(parents=True, exist_ok=True)
        self._lineage = dict(lineage)
        place = None if server() else (artifacts.resolve() / experiment).as_uri()
        self.client = connect(store)
        known = self.client.get_experiment_by_name(experiment)
        if known is not None and known.lifecycle_stage == "deleted":
            raise InputError(
                f"MLflow's experiment '{experiment}' is deleted; restore it, or name another as tracking.experiment"
            )
        self.experiment = str(
            known.experiment_id
            if known
            else self.client.create_experiment(experiment, place, tags={KIND: TRAINING})
        )

    def log(self, content: Content, parent: str | None = None) -> str:
        """Log a run unless one with the same name and content exists; returns its id.

        parent: id of the parent run. An existing run moves under it. A run that was killed while it was logged is logged to its end: MLflow
        takes a number, a data set or a file that it has already once more.
        """
        digest = content.digest
        known = self._known(content.name, digest)
        if known is not None and parent is not None and known.data.tags.get(PARENT) != parent:
            self.client.set_tag(known.info.run_id, PARENT, parent)
        if known is not None and known.info.status == FINISHED:
            self._log_pictures(known.info.run_id, content, known.data.tags.get(PICTURES, ""))
            self.log_results(known.info.run_id, content, known.data.metrics)
            return str(known.info.run_id)
        if known is None:
            tags = {**self._lineage, **content.tags, DIGEST: digest, "kind": content.kind} | (
                {} if parent is None else {PARENT: parent}
            )
            known = self.client.create_run(self.experiment, run_name=content.name, tags=tags)
        run_id = str(known.info.run_id)
        self._log_numbers(run_id, content)
        self.log_results(run_id, content, known.data.metrics)
        if content.data:
            self.client.log_inputs(run_id, [_dataset(data) for data in content.data])
        for path in content.files:
            self.client.log_artifact(run_id, str(path))
        self._log_pictures(run_id, content)
        self.client.set_terminated(run_id)
        return run_id

    def describe(self, run_id: str, text: str, compared: Sequence[str] = ()) -> None:
        """Set a run's description, Markdown, cut to MLflow's limit, with a link that opens MLflow's comparison of some runs."""
        if compared:
            ids = ",".join(f"%22{run}%22" for run in compared)
            text = f"[Compare the versions](#/compare-runs?runs=[{ids}]&experiments=[%22{self.experiment}%22])\n\n{text}"
        self.client.set_tag(run_id, DESCRIPTION, shortened(text, ROOM))

    def _log_pictures(self, run_id: str, content: Content, logged: str = "") -> None:
        """logged: the digest of those that the run has."""
        digest = hashlib.sha256(json.dumps(_named_digests(content.pictures)).encode()).hexdigest()
        if content.pictures and digest != logged:
            for path in content.pictures:
                self.client.log_artifact(run_id, str(path))
            self.client.set_tag(run_id, PICTURES, digest)

    def log_results(
        self,
        run_id: str,
        content: Content,
        logged: Mapping[str, float],
        model_id: str | None = None,
    ) -> None:
        """The metrics that differ from those of a run or its logged model; MLflow shows the newest."""
        from mlflow.entities import Metric

        now = time.time_ns() // 1_000_000
        changed = [
            Metric(*point, now, 0, model_id=model_id)
            for point in content.results.items()
            if logged.get(point[0]) != point[1]
        ]
        if changed:
            self.client.log_batch(run_id, metrics=changed)

    def _log_numbers(self, run_id: str, content: Content) -> None:
        from mlflow.entities import Metric, Param

        # A fixed time: metrics have no time of measurement, and the steps order a series.
        points = [Metric(name, float(value), 0, 0) for name, value in content.metrics.items()]
        points += [
            Metric(name, float(value), 0, step)
            for name, values in content.series.items()
            for step, value in values
        ]
        params = [Param(name, value) for name, value in content.params.items()]
        for begin in range(0, len(params), PARAMS):
            self.client.log_batch(run_id, params=params[begin : begin + PARAMS])
        for begin in range(0, len(points), BATCH):
            self.client.log_batch(run_id, metrics=points[begin : begin + BATCH])

    def _known(self, name: str, digest: str) -> Run | None:
        """The run with this name and content, a finished one before one that was killed."""
        runs = self.client.search_runs(
            [self.experiment], f"tags.`{DIGEST}` = '{digest}' and attributes.run_name = '{name}'"
        )
        return next((run for run in runs if run.info.status == FINISHED), runs[0] if runs else None)


def shortened(text: str, room: int) -> str:
    """Markdown of at most `room` characters: whole lines, and a word on the rest."""
    if len(text) <= room:
        return text
    cut = text[: room - 100].rpartition("\n")[0]
    return cut + ("\n```" if cut.count("```") % 2 else "") + "\n\nThe rest is in the report."


def _named_digests(paths: Sequence[Path]) -> list[tuple[str, str]]:
    return sorted((path.name, sha256(path)) for path in paths)


def _dataset(data: DataSet) -> Any:
    from mlflow.entities import Dataset, DatasetInput, InputTag

    described = Dataset(data.name, data.digest[:32], "local", json.dumps({"uri": data.source}))
    return DatasetInput(described, [InputTag("mlflow.data.context", data.context)])
