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
    """Data that a run used.

    Attributes:
        source: Its location.
        context: Its purpose, such as `training`.
    """

    name: str
    digest: str
    source: str
    context: str


@dataclass(frozen=True)
class Content:
    """The content of a run.

    Attributes:
        series: Name -> (step, value) pairs.
        files: Logged at the top of the run's artifacts.
        pictures: Logged with the run, but not part of its identity: redrawing makes no new run.
        results: Metrics that a later comparison adds; not part of its identity, either.
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
        """SHA-256 of everything but pictures, results, paths and times; files by their bytes."""
        plain = asdict(self)
        del plain["pictures"], plain["results"]
        plain["files"] = _named_digests(self.files)
        return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


class Tracker:
    """One experiment; makes store, artifacts and experiment if they are missing."""

    def __init__(
        self, store: Path, artifacts: Path, experiment: str, lineage: Mapping[str, str]
    ) -> None:
        """Connect to MLflow.

        Args:
            store: SQLite file of the runs, without a server.
            artifacts: Folder of their files, without a server.
            experiment: Name of the experiment.
            lineage: Tags on every new run that are not part of its content, such as the commit.

        Raises:
            InputError: The experiment is deleted, or MLflow cannot be used.
        """
        if server() is None:
            artifacts.mkdir(parents=True, exist_ok=True)
        self._lineage = dict(lineage)
        place = None if server() else (artifacts.resolve() / experiment).as_uri()
        self.client = connect(store)
        existing = self.client.get_experiment_by_name(experiment)
        if existing is None:
            tags = {KIND: TRAINING}
            self.experiment = str(self.client.create_experiment(experiment, place, tags=tags))
        elif existing.lifecycle_stage == "deleted":
            raise InputError(
                f"MLflow's experiment '{experiment}' is deleted; restore it, or name another as "
                "tracking.experiment"
            )
        else:
            self.experiment = str(existing.experiment_id)

    def log(self, content: Content, parent: str | None = None) -> str:
        """Log a run unless one with the same name and content exists.

        A run that was killed while it was logged is logged to its end: MLflow accepts a number, a
        data set or a file that it has already.

        Args:
            content: The content of the run.
            parent: Id of the parent run; an existing run moves under it.

        Returns:
            The id of the run.
        """
        digest = content.digest
        run = self._existing(content.name, digest)
        if run is None:
            tags = {**self._lineage, **content.tags, DIGEST: digest, "kind": content.kind}
            if parent is not None:
                tags[PARENT] = parent
            run = self.client.create_run(self.experiment, run_name=content.name, tags=tags)
        elif parent is not None and run.data.tags.get(PARENT) != parent:
            self.client.set_tag(run.info.run_id, PARENT, parent)
        run_id = str(run.info.run_id)
        if run.info.status == FINISHED:
            self._log_pictures(run_id, content, run.data.tags.get(PICTURES, ""))
            self.log_results(run_id, content, run.data.metrics)
            return run_id
        self._log_numbers(run_id, content)
        self.log_results(run_id, content, run.data.metrics)
        if content.data:
            self.client.log_inputs(run_id, _inputs(content.data))
        for path in content.files:
            self.client.log_artifact(run_id, str(path))
        self._log_pictures(run_id, content)
        self.client.set_terminated(run_id)
        return run_id

    def describe(self, run_id: str, text: str, compared: Sequence[str] = ()) -> None:
        """Set a run's description.

        Args:
            run_id: Id of the run.
            text: Markdown; it is cut to MLflow's limit.
            compared: Ids of runs; the description links to MLflow's comparison of them.
        """
        if compared:
            ids = ",".join(f"%22{run}%22" for run in compared)
            link = f"#/compare-runs?runs=[{ids}]&experiments=[%22{self.experiment}%22]"
            text = f"[Compare the versions]({link})\n\n{text}"
        self.client.set_tag(run_id, DESCRIPTION, shortened(text, ROOM))

    def _log_pictures(self, run_id: str, content: Content, logged: str = "") -> None:
        """Log the pictures unless they are logged. logged: digest of the run's pictures."""
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
        """Log the results that differ from those of a run; MLflow shows the newest value.

        Args:
            run_id: Id of the run.
            content: The content with the results.
            logged: Metrics that the run or its logged model has.
            model_id: Id of the logged model, to log its results.
        """
        from mlflow.entities import Metric

        now = time.time_ns() // 1_000_000
        changed = []
        for name, value in content.results.items():
            if logged.get(name) != value:
                changed.append(Metric(name, value, now, 0, model_id=model_id))
        if changed:
            self.client.log_batch(run_id, metrics=changed)

    def _log_numbers(self, run_id: str, content: Content) -> None:
        from mlflow.entities import Metric, Param

        # A fixed time: metrics have no time of measurement, and the steps order a series.
        points = [Metric(name, float(value), 0, 0) for name, value in content.metrics.items()]
        for name, values in content.series.items():
            points += [Metric(name, float(value), 0, step) for step, value in values]
        params = [Param(name, value) for name, value in content.params.items()]
        for begin in range(0, len(params), PARAMS):
            self.client.log_batch(run_id, params=params[begin : begin + PARAMS])
        for begin in range(0, len(points), BATCH):
            self.client.log_batch(run_id, metrics=points[begin : begin + BATCH])

    def _existing(self, name: str, digest: str) -> Run | None:
        """The run with this name and content, a finished one before one that was killed."""
        query = f"tags.`{DIGEST}` = '{digest}' and attributes.run_name = '{name}'"
        runs = self.client.search_runs([self.experiment], query)
        return next((run for run in runs if run.info.status == FINISHED), runs[0] if runs else None)


def shortened(text: str, room: int) -> str:
    """Markdown of at most `room` characters, cut at a line end, with a note about the cut."""
    if len(text) <= room:
        return text
    cut = text[: room - 100].rpartition("\n")[0]
    return cut + ("\n```" if cut.count("```") % 2 else "") + "\n\nThe rest is in the report."


def _named_digests(paths: Sequence[Path]) -> list[tuple[str, str]]:
    return sorted((path.name, sha256(path)) for path in paths)


def _inputs(sets: Sequence[DataSet]) -> list[Any]:
    """Data sets in MLflow's form."""
    from mlflow.entities import Dataset, DatasetInput, InputTag

    inputs = []
    for data in sets:
        described = Dataset(data.name, data.digest[:32], "local", json.dumps({"uri": data.source}))
        inputs.append(DatasetInput(described, [InputTag("mlflow.data.context", data.context)]))
    return inputs
