"""Tracking in a real MLflow store."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mlflow import MlflowClient
from mlflow.entities import ViewType
from mlflow.exceptions import MlflowException

from pipeline.__main__ import main
from pipeline.artefacts import stamps
from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.files import read_json
from pipeline.artefacts.model_card import read_card, write_card
from pipeline.artefacts.results import read, write
from pipeline.artefacts.tracking_results import TrackedStudy
from pipeline.config.composing import compose
from pipeline.errors import InputError
from pipeline.tracking.contents import model_content
from pipeline.tracking.registry import Registration, Registry, registered
from pipeline.tracking.runs import Content, DataSet, Tracker
from tests.analysis.fabricated import VERSIONS, FabricatedStudy


def run(study: FabricatedStudy, drawn: bytes = b"a plot") -> None:
    plot = study.root / "theta.png"
    plot.write_bytes(drawn)
    study.run("track", {"plots": [str(plot)]})


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> FabricatedStudy:
    fabricated = FabricatedStudy(tmp_path_factory.mktemp("study")).make_analysed()
    run(fabricated)
    return fabricated


def client(study: FabricatedStudy) -> Any:
    assert os.environ["MLFLOW_DISABLE_TELEMETRY"] == "true"
    uri = f"sqlite:///{study.folder / 'data' / 'mlflow' / 'mlflow.db'}"
    return MlflowClient(tracking_uri=uri, registry_uri=uri)


def everything(study: FabricatedStudy) -> tuple[int, int, int]:
    store = client(study)
    experiment = store.get_experiment_by_name("blindspot/default")
    runs = store.search_runs([experiment.experiment_id], max_results=500)
    return (
        len(runs),
        len(store.search_model_versions("name='detector'")),
        len(store.search_logged_models([experiment.experiment_id])),
    )


def test_a_run_per_campaign_comparison_and_version(study: FabricatedStudy) -> None:
    assert everything(study) == (1 + 8 + 4 + 1 + 4, 4, 4)


def test_registered_versions_carry_failures_and_lineage(study: FabricatedStudy) -> None:
    comparison, store = read(study.root / "comparison.json", Comparison), client(study)
    versions = {v.tags["version"]: v for v in store.search_model_versions("name='detector'")}
    assert set(versions) == set(VERSIONS)
    for result in comparison.versions:
        tags = {
            "study": "default",
            "version": result.version,
            "failures": str(result.failures),
            "verdict": result.verdict,
        }
        assert versions[result.version].tags == tags
        assert (
            store.get_model_version_by_alias("detector", f"default-{result.version}").version
            == versions[result.version].version
        )
        run_data = store.get_run(versions[result.version].run_id).data
        assert run_data.metrics["failures"] == result.failures
        assert run_data.metrics["failures.F1star"] == result.scenarios["F1star"].failures
        assert run_data.params["parent"] == ("none" if result.version == "base" else "base")
        assert run_data.tags["data.base_set"] == "ab" * 32
        assert run_data.tags["mlflow.source.git.commit"]
        files = {
            path.name
            for path in Path(versions[result.version].source.removeprefix("file://")).iterdir()
        }
        assert {"weights.safetensors", "artifacts", "model.json", "MLmodel"} <= files
    champion = store.get_model_version_by_alias("detector", "champion")
    assert champion.tags["version"] == comparison.champion


def test_logged_models_can_be_ordered_by_failures(study: FabricatedStudy) -> None:
    store = client(study)
    experiment = store.get_experiment_by_name("blindspot/default").experiment_id
    ordered = store.search_logged_models(
        [experiment], order_by=[{"field_name": "metrics.failures", "ascending": True}]
    )
    assert ordered[0].name == "default-adaptive"


def test_theta_is_a_series(study: FabricatedStudy) -> None:
    store = client(study)
    experiment = store.get_experiment_by_name("blindspot/default").experiment_id
    (campaign,) = store.search_runs([experiment], "attributes.run_name = 'default/F1/mixed/base/0'")
    points = store.get_metric_history(campaign.info.run_id, "failures_found")
    theta = read_json(study.root / "measures.json")["campaigns"][2]
    assert (theta["strategy"], theta["seed"]) == ("mixed", 0)
    assert [point.value for point in sorted(points, key=lambda p: p.step)] == theta["theta"]


def test_tracking_again_changes_nothing_and_a_new_result_adds_a_run(study: FabricatedStudy) -> None:
    before, written = everything(study), (study.root / "tracking.json").read_bytes()
    run(study)
    assert everything(study) == before
    assert (study.root / "tracking.json").read_bytes() == written
    card = read_card(study.cards[1])
    write_card(study.cards[1], card.model_copy(update={"training": {"iterations": 7.0}}))
    run(study)
    assert everything(study) == (before[0] + 1, before[1] + 1, before[2] + 1)
    assert read(study.root / "tracking.json", TrackedStudy).champion == "adaptive"


def test_redrawn_results_keep_the_version_and_update_the_picture(study: FabricatedStudy) -> None:
    before, store = everything(study), client(study)
    run(study, b"the plot in other colours")
    assert everything(study) == before
    for version in store.search_model_versions("name='detector'"):
        if (
            version.tags["version"] != "control"
        ):  # The previous test left two versions; the older one's run belongs to no study now.
            assert (
                Path(store.download_artifacts(version.run_id, "theta.png")).read_bytes()
                == b"the plot in other colours"
            )


def test_a_later_comparison_moves_the_alias_and_registers_nothing_again(
    study: FabricatedStudy,
) -> None:
    path, store = study.root / "comparison.json", client(study)
    before, counted = path.read_bytes(), everything(study)
    comparison = read(path, Comparison)
    stamps.withdraw(path.with_name("comparison.json.stamp"))
    held = store.get_model_version_by_alias("detector", "champion")
    assert held.tags["version"] == comparison.champion == "adaptive"
    # More tests show that it is worse than the base.
    worse = tuple(
        v.model_copy(update={"failures": 99}) if v.version == "adaptive" else v
        for v in comparison.versions
    )
    gate = {**comparison.gate, "adaptive": "held back: so"}
    lost = tuple(
        pair.model_copy(update={"fixes": pair.regressions, "regressions": pair.fixes})
        for pair in comparison.pairs
    )
    write(
        path,
        comparison.model_copy(
            update={
                "champion": "base",
                "gate": gate,
                "passing": (),
                "versions": worse,
                "pairs": lost,
            }
        ),
    )
    run(study)
    champion = store.get_model_version_by_alias("detector", "champion")
    assert champion.tags["version"] == "base"
    # The version is unchanged, its description is new.
    again = store.get_model_version("detector", held.version)
    assert again.tags["failures"] == "99"
    assert (
        "- adaptive is held back: so." in again.description
        and "| **adaptive** | **99 / " in again.description
    )
    assert store.get_run(again.run_id).data.metrics["failures"] == 99
    experiment = store.get_experiment_by_name("blindspot/default").experiment_id
    best = store.search_logged_models(
        [experiment], order_by=[{"field_name": "metrics.failures", "ascending": False}]
    )
    assert best[0].name == "default-adaptive"
    (parent,) = store.search_runs([experiment], "attributes.run_name = 'default'")
    assert (
        "Champion moves from adaptive to base, which fails significantly less."
        in parent.data.tags["mlflow.note.content"]
    )
    assert everything(study) == (
        counted[0] + 1,
        *counted[1:],
    )  # The comparison itself is a new run.
    path.write_bytes(before)
    run(study)
    assert store.get_model_version_by_alias("detector", "champion").version == held.version
    assert store.get_run(held.run_id).data.metrics["failures"] == next(
        v.failures for v in comparison.versions if v.version == "adaptive"
    )


def test_a_champion_that_was_not_compared_keeps_the_alias(study: FabricatedStudy) -> None:
    file = study.root / "other.json"
    file.write_text("{}")
    content = Content("elsewhere/adaptive", "model", tags={"weights_sha256": "cd"})
    other = Registration("detector", content, [file], {"study": "elsewhere", "version": "adaptive"})
    registry = Registry(_elsewhere(study))
    number, _ = registry.register(other)
    held = client(study).get_model_version_by_alias("detector", "champion").version
    registry.set_alias("detector", "champion", number)
    run(study)
    assert client(study).get_model_version_by_alias("detector", "champion").version == int(number)
    registry.set_alias("detector", "champion", held)
    client(study).delete_model_version("detector", number)


def test_a_champion_of_another_study_with_equal_weights_counts_as_compared(
    study: FabricatedStudy,
) -> None:
    store, registry = client(study), Registry(_elsewhere(study))
    held = store.get_model_version_by_alias("detector", "champion")
    assert held.tags["version"] == "adaptive"
    file = study.root / "other.json"
    file.write_text("{}")
    tags = {"weights_sha256": read_card(study.cards[0]).weights_sha256}
    content = Content("elsewhere/base", "model", tags=tags)
    number, _ = registry.register(
        Registration("detector", content, [file], {"study": "elsewhere", "version": "base"})
    )
    registry.set_alias("detector", "champion", number)
    run(
        study
    )  # The weights are the base's, which fails significantly more than the comparison's champion.
    assert store.get_model_version_by_alias("detector", "champion").version == held.version
    store.delete_model_version("detector", number)


def _elsewhere(study: FabricatedStudy) -> Tracker:
    mlflow = study.folder / "data" / "mlflow"
    return Tracker(mlflow / "mlflow.db", mlflow / "artifacts", "elsewhere", {})


def test_a_deleted_experiment_is_named(tmp_path: Path) -> None:
    tracker = Tracker(tmp_path / "m.db", tmp_path / "artifacts", "e", {})
    tracker.client.delete_experiment(tracker.experiment)
    with pytest.raises(InputError, match="MLflow's experiment 'e' is deleted"):
        Tracker(tmp_path / "m.db", tmp_path / "artifacts", "e", {})


def test_an_interrupted_run_is_logged_to_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, picture = tmp_path / "table.csv", tmp_path / "plot.png"
    file.write_text("a")
    picture.write_bytes(b"b")
    content = Content(
        name="one",
        kind="campaign",
        params={"k": "2"},
        metrics={"failures": 3.0},
        series={"theta": [(1, 0.0), (2, 1.0)]},
        tags={"strategy": "random"},
        files=[file],
        data=[DataSet("tests", "d" * 64, "tests.parquet", "testing")],
        pictures=[picture],
        results={"p_value": 0.5},
    )
    tracker = Tracker(tmp_path / "m.db", tmp_path / "artifacts", "e", {})
    for method in ("log_batch", "log_inputs", "log_artifact", "set_tag", "set_terminated"):
        with monkeypatch.context() as patch:
            patch.setattr(
                tracker.client, method, lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt)
            )
            with pytest.raises(KeyboardInterrupt):
                tracker.log(content)
    run_id = tracker.log(content)
    (run,) = tracker.client.search_runs([tracker.experiment], run_view_type=ViewType.ALL)
    assert (run.info.run_id, run.info.status, run.data.params) == (run_id, "FINISHED", {"k": "2"})
    assert {
        name: len(tracker.client.get_metric_history(run_id, name)) for name in run.data.metrics
    } == {
        "failures": 1,
        "theta": 2,
        "p_value": 1,
    }
    assert len(run.inputs.dataset_inputs) == 1
    assert {artifact.path for artifact in tracker.client.list_artifacts(run_id)} == {
        "table.csv",
        "plot.png",
    }
    assert tracker.log(content) == run_id


def test_versions_prints_the_failures_of_every_version(
    study: FabricatedStudy, capsys: pytest.CaptureFixture[str]
) -> None:
    comparison = read(study.root / "comparison.json", Comparison)
    assert main(["versions", "--store", str(study.folder / "data" / "mlflow" / "mlflow.db")]) == 0
    head, *rows = (line.split() for line in capsys.readouterr().out.splitlines())
    assert head[:5] == ["model", "number", "version", "study", "failures"]
    shown = {row[2]: int(row[4]) for row in rows}
    assert shown == {result.version: result.failures for result in comparison.versions}
    assert [row[2] for row in rows if "champion," in row] == [comparison.champion]
    assert {row[-1] for row in rows} >= {f"default-{version}" for version in VERSIONS}
    assert main(["versions", "--store", "nowhere.db"]) == 2
    assert "nowhere.db: expected MLflow's database, found no file" in capsys.readouterr().err


def test_runs_are_nested_under_the_study(study: FabricatedStudy) -> None:
    store = client(study)
    experiment = store.get_experiment_by_name("blindspot/default").experiment_id
    (parent,) = store.search_runs([experiment], "attributes.run_name = 'default'")
    children = store.search_runs(
        [experiment], f"tags.`mlflow.parentRunId` = '{parent.info.run_id}'"
    )
    assert len({run.info.run_name for run in children}) == 8 + 4 + 1 + 4
    assert parent.data.params["campaign.tests"] == "60" and parent.data.params["seeds"] == "0 1"
    assert (
        "adaptive ★" in parent.data.tags["mlflow.note.content"]
        and "#/compare-runs?runs=[%22" in parent.data.tags["mlflow.note.content"]
    )


def test_a_long_description_is_cut_at_a_line(tmp_path: Path) -> None:
    tracker = Tracker(tmp_path / "m.db", tmp_path / "artifacts", "e", {})
    run_id = tracker.log(Content("one", "study"))
    tracker.describe(run_id, "\n".join(["```", *["a version passes"] * 1000, "```"]))
    text = tracker.client.get_run(run_id).data.tags["mlflow.note.content"]
    assert 7800 < len(text) <= 8000 and text.endswith(
        "a version passes\n```\n\nThe rest is in the report."
    )


def test_curves_have_their_iterations_and_runs_their_data(study: FabricatedStudy) -> None:
    store = client(study)
    versions = {v.tags["version"]: v for v in store.search_model_versions("name='detector'")}
    run_id = versions["adaptive"].run_id
    assert [(p.step, p.value) for p in store.get_metric_history(run_id, "training.ap50")] == [
        (10, 0.8),
        (20, 0.85),
    ]
    (data,) = store.get_run(run_id).inputs.dataset_inputs
    assert (data.dataset.name, data.dataset.digest, data.tags[0].value) == (
        "base_set",
        "ab" * 16,
        "training",
    )
    experiment = store.get_experiment_by_name("blindspot/default").experiment_id
    compared = store.search_runs([experiment], "attributes.run_name = 'default/comparison'")[0]
    (data,) = compared.inputs.dataset_inputs
    digest = read(study.root / "comparison.json", Comparison).sequence_digest
    assert (data.dataset.name, data.dataset.digest, data.tags[0].value) == (
        "held_out",
        digest[:32],
        "evaluation",
    )


def test_the_source_of_added_images_is_named(study: FabricatedStudy) -> None:
    config = compose("default", ["+arms.fresh=new_scenes", "retraining.seeds=[4]"])
    path, (*_, result) = (
        study.root / "retrained/models/adaptive/model.json",
        read(study.root / "comparison.json", Comparison).versions,
    )
    sources = {}
    for version in ("random", "fresh"):
        card = read_card(path).model_copy(update={"version": version, "data": {"added": "d" * 64}})
        (data,) = model_content(config, card, result, path, []).data
        sources[version] = data.source
    assert sources == {
        "random": "data/default/campaigns",
        "fresh": "data/default/retrained/scenes/new_scenes/4",
    }


def test_the_campaigns_of_a_version_name_it(study: FabricatedStudy) -> None:
    store = client(study)
    experiment = store.get_experiment_by_name("blindspot/default").experiment_id
    numbers = {
        version: store.get_model_version_by_alias("detector", f"default-{version}").version
        for version in VERSIONS
    }
    runs_of = {}
    for version, number in numbers.items():
        runs = store.search_runs([experiment], f"tags.model_version = 'detector/{number}'")
        runs_of[version] = [run.info.run_name for run in runs]
    assert runs_of["adaptive"] == ["default/F1star/pairwise/adaptive/0"]
    assert len(runs_of["base"]) == 8 + 1


def test_descriptions_are_the_verdict_table(study: FabricatedStudy) -> None:
    comparison, store = read(study.root / "comparison.json", Comparison), client(study)
    texts = {
        version: store.get_model_version_by_alias("detector", f"default-{version}").description
        for version in VERSIONS
    }
    assert store.get_registered_model("detector").description == texts["base"].replace("**", "")
    for result in comparison.versions:
        (row,) = [line for line in texts[result.version].splitlines() if line.startswith("| **")]
        assert (
            row.startswith(f"| **{result.version}")
            and f"**{result.failures} / {result.tests}**" in row
        )
        assert sum(line.startswith("| ") for line in texts[result.version].splitlines()) == 2 + len(
            VERSIONS
        )


def test_a_registered_version_loads_and_detects_in_images_of_any_size(
    study: FabricatedStudy,
) -> None:
    import mlflow

    source = client(study).get_model_version_by_alias("detector", "default-random").source
    model = mlflow.pyfunc.load_model(source)
    boxes = model.predict(np.zeros((2, 192, 320, 3), np.uint8))
    assert list(boxes.columns) == ["image", "left", "top", "right", "bottom", "score"]
    assert boxes["image"].tolist() == [0, 1] and boxes["score"].tolist() == pytest.approx(
        [0.2, 0.2]
    )
    assert boxes.iloc[0, 1:5].tolist() == [150, 80, 170, 120]
    # Twice the width and three times the height: scaled by a third, padded at the left and right.
    assert model.predict(np.zeros((1, 576, 640, 3), np.uint8)).iloc[
        0, 1:5
    ].tolist() == pytest.approx([290, 240, 350, 360], abs=1)
    # A threshold above the only score.
    assert (
        mlflow.pyfunc.load_model(source, model_config={"threshold": 0.3})
        .predict(np.zeros((1, 192, 320, 3), np.uint8))
        .empty
    )


def test_a_served_detector_reports_what_a_tested_one_does() -> None:
    from pipeline.detectors.suppression import reported
    from pipeline.tracking.served_detector import suppressed

    rng = np.random.default_rng(0)
    for _ in range(50):
        corners = rng.uniform(0, 80, (30, 2))
        boxes = np.concatenate([corners, corners + rng.uniform(5, 40, (30, 2))], axis=1).astype(
            np.float32
        )
        scores = rng.uniform(0, 1, 30).astype(np.float32)
        kept = list(suppressed(boxes, np.where(scores >= 0.4, scores, -1), 0.45))
        expected = reported("model", boxes, scores, 0.4, 0.45)
        assert np.array_equal(boxes[kept], expected.boxes) and np.array_equal(
            scores[kept], expected.scores
        )


def test_a_served_detector_drops_boxes_in_the_border_as_a_tested_one_does() -> None:
    from pipeline.tracking.served_detector import ServedDetector

    class Session:
        def run(self, *_: object) -> list[np.ndarray]:
            """Two boxes in 320x192 pixels, the first in the border above an image of 320x120."""
            return [
                np.array([[[10, 0, 40, 20], [10, 60, 40, 120]]], np.float32),
                np.array([[0.9, 0.8]], np.float32),
            ]

    served = ServedDetector()
    served._session, served._width, served._height = Session(), 320, 192
    detections = list(served._detect(np.zeros((120, 320, 3), np.uint8), 0.1, 0.45))
    assert [(*box.tolist(), float(score)) for box, score in detections] == [
        pytest.approx((10, 24, 40, 84, 0.8))
    ]


def test_an_interrupted_registration_leaves_one_model_and_one_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker, file = (
        Tracker(tmp_path / "m.db", tmp_path / "artifacts", "e", {}),
        tmp_path / "model.json",
    )
    registry = Registry(tracker)
    file.write_text("{}")
    registration = Registration(
        "detector",
        Content("s/base", "model", metrics={"failures": 3.0}),
        [file],
        {"version": "base"},
    )
    for method in ("log_model_artifact", "finalize_logged_model", "create_model_version"):
        with monkeypatch.context() as patch:
            patch.setattr(
                tracker.client, method, lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt)
            )
            with pytest.raises(KeyboardInterrupt):
                registry.register(registration)
    first = registry.register(registration)
    assert registry.register(registration) == first
    store = tracker.client
    assert len(store.search_model_versions("name='detector'")) == 1
    assert len(store.search_logged_models([tracker.experiment])) == 1
    assert len(store.search_runs([tracker.experiment])) == 1


def test_an_empty_address_names_no_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "")
    with pytest.raises(InputError, match=r"m\.db: expected MLflow's database, found no file"):
        registered(tmp_path / "m.db")


def test_a_missing_server_is_named(
    study: FabricatedStudy, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    with pytest.raises(InputError, match="MLflow at http://127.0.0.1:9 cannot be used"):
        run(study)
    assert main(["versions"]) == 2
    assert "MLflow at http://127.0.0.1:9 cannot be used" in capsys.readouterr().err


@pytest.mark.parametrize("method", ["create_run", "log_artifact", "set_registered_model_alias"])
def test_a_store_that_refuses_in_the_middle_is_named(
    tmp_path: Path, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise MlflowException("the disk of the server is full")

    fabricated = FabricatedStudy(tmp_path).make_analysed()
    monkeypatch.setattr(MlflowClient, method, refuse)
    with pytest.raises(
        InputError,
        match=r"MLflow at data/mlflow/mlflow\.db cannot be used: the disk of the server is full",
    ):
        run(fabricated)
