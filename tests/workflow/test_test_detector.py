"""`test-detector` tests and compares any detectors, resumes, and names what is wrong."""

from __future__ import annotations

import sys
from contextlib import chdir
from pathlib import Path

import numpy as np
import pytest

from pipeline.__main__ import main
from pipeline.artefacts.calibration_results import DetectorCalibration
from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.model_card import read_card, write_card
from pipeline.artefacts.results import read
from pipeline.artefacts.search_results import Measures
from pipeline.commands import test_detector
from pipeline.config.composing import compose
from pipeline.contract import REJECTED
from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.detectors.yolo.export import export_version
from pipeline.errors import InputError
from tests.analysis.fabricated import OVERRIDES, FabricatedStudy
from tests.onnx_models import export, yolov8
from tests.studies import ROOT, fill_cache
from tests.warm_python import warm_python

SMALL = [
    "campaign.tests=6",
    "search=[F1]",
    "seeds=[0]",
    "comparison.tests=6",
    "samplers.mixed.batch_size=3",
    "report.replays=2",
]
ANALYTIC = [*SMALL, "simulator=analytic", "detector.threshold=0.5"]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export(tmp_path_factory.mktemp("model") / "mine.onnx", yolov8())


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the workflow's files, as a checkout has them."""
    for name in ("Snakefile", "profiles", "pipeline", "models"):
        (tmp_path / name).symlink_to(ROOT / name)
    fill_cache(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setattr(sys, "executable", str(warm_python()))
    return tmp_path


class Doubtful:
    """Boxes the pedestrian with less confidence than it deserves: of the boxes with score 0.3, nine
    in ten are right."""

    def __init__(
        self,
        model: str,
        threshold: float = 0.5,
        iou: float = 0.5,
        layout: None = None,
        person: None = None,
    ) -> None:
        self._threshold = threshold

    def detect(self, frame: Frame) -> Detections:
        box = frame.truth.visible_box
        if box is None:
            return Detections.none()
        chance = int(frame.image.sum(dtype=np.int64)) % 100
        score, right = (0.3, chance % 10 > 0) if chance >= 40 else (0.1, chance % 2 > 0)
        if score < self._threshold:
            return Detections.none()
        height, width = frame.image.shape[:2]
        detected = box if right else (0.0, 0.0, width / 8, height / 8)
        return Detections(np.array([detected], np.float32), np.array([score], np.float32))


class Tires(Doubtful):
    """Passes the check on three images and fails on the next."""

    seen = 0

    def detect(self, frame: Frame) -> Detections:
        self.seen += 1
        if self.seen > 10:
            raise RuntimeError("no more")
        return super().detect(frame)


def test_a_job_that_refuses_its_input_ends_the_run_with_2(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (folder / "mine.bin").write_text("mine")
    named = ["simulator=analytic", f"detector._target_={__name__}.Tires", "base_set.images=40"]
    assert main(["test-detector", "mine.bin", *SMALL, *named, "--calibrate"]) == 2
    printed = capfd.readouterr().err
    assert (
        "fails on validation image 11: Tires.detect failed: RuntimeError: no more" in printed
        and "Traceback" not in printed
    )
    assert (folder / REJECTED).exists()


def test_a_detector_is_calibrated_before_it_is_tested(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "mine.bin").write_text("mine")
    named = [
        "simulator=analytic",
        f"detector._target_={__name__}.Doubtful",
        "base_set.images=300",
        "strategies=[random]",
    ]
    words = ["test-detector", "mine.bin", *SMALL, *named, "--calibrate"]
    assert main(words) == 0
    text = capsys.readouterr().out
    (root,) = (folder / "data").iterdir()
    calibration = read(root / "calibration/mine_bin.json", DetectorCalibration)
    assert (
        calibration.fitted
        and calibration.images == 150
        and 0 < calibration.right < calibration.detections
    )
    # The share of right boxes is 0.9 among those with score 0.3.
    assert (
        calibration.scaling.apply(0.3) > 0.7
        and calibration.errors["calibrated"] < calibration.errors["uncalibrated"] / 2
    )
    assert "mine_bin is calibrated on 150 images: expected calibration error" in text
    page = (root / "reports/mine_bin.html").read_text()
    assert ">Calibration<" in page and "mine_bin, before and after calibration" in page
    # Called again, nothing is made again.
    times = {path: path.stat().st_mtime_ns for path in root.rglob("*.json")}
    assert main(words) == 0
    assert times == {path: path.stat().st_mtime_ns for path in root.rglob("*.json")}


def test_two_detectors_are_tested_compared_and_shown(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = yolov8()
    output[0, 4:] /= 2
    export(folder / "ours.onnx", output)
    words = ["test-detector", "ours.onnx", "models/uniform/weights.safetensors", *ANALYTIC]
    assert main(words) == 0
    text = capsys.readouterr().out
    (root,) = (folder / "data").iterdir()
    export_version(
        ROOT / "models/uniform/weights.safetensors",
        ROOT / "models/uniform/model.json",
        folder / "expected.onnx",
    )
    assert (root / "exported/uniform.onnx").read_bytes() == (folder / "expected.onnx").read_bytes()
    assert (
        root.name.startswith("ours-") and f"Next: open data/{root.name}/reports/ours.html" in text
    )
    measures = read(root / "measures.json", Measures)
    assert [(row.version, row.tests) for row in measures.strategies] == [
        (name, 6) for name in ("ours", "uniform") for _ in range(2)
    ]
    comparison = read(root / "comparison.json", Comparison)
    rounds = [version.round for version in comparison.versions] + [
        group.round for group in comparison.groups
    ]
    assert rounds == [0] * 4, "neither was retrained"
    assert [(result.version, result.tests) for result in comparison.versions] == [
        ("ours", 6),
        ("uniform", 6),
    ]
    assert (root / "regions/uniform/F1.json").is_file()
    for name in ("ours", "uniform"):
        page = (root / f"reports/{name}.html").read_text()
        assert "Failures found" in page and "Coverage of the scenario space" in page
        assert "Single-image detection" not in page, "nothing was trained"
    assert main(["verdict", "--params", str(root / "params.yaml")]) == 0
    printed = capsys.readouterr().out
    assert (
        printed.startswith("Held out: F1*; the same tests for every version")
        and f"Next: open data/{root.name}/reports/ours.html" in printed
    )
    # Called again, nothing is executed again.
    table = root / "campaigns/F1/random/ours/0/tests.parquet"
    times = table.stat().st_mtime_ns
    assert main(words) == 0
    assert table.stat().st_mtime_ns == times and "failure rate" in capsys.readouterr().out


def test_weights_without_a_card_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "best.safetensors").symlink_to(ROOT / "models/uniform/weights.safetensors")
    assert main(["test-detector", "best.safetensors", *ANALYTIC]) == 2
    assert "model.json: expected a readable file" in capsys.readouterr().err
    with pytest.raises(
        InputError,
        match=r"^tested\.best: expected the card of these weights beside them, found no "
        r"model\.json$",
    ):
        compose("default", ["goal=detectors", "+tested.best=best.safetensors"])


def test_weights_that_learnt_from_the_held_out_town_are_refused(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    town = compose("default", []).scenarios["F1star"].town.fingerprint
    (folder / "mine").mkdir()
    (folder / "mine/weights.safetensors").symlink_to(ROOT / "models/uniform/weights.safetensors")
    card = read_card(ROOT / "models/uniform/model.json")
    write_card(
        folder / "mine/model.json",
        card.model_copy(update={"version": "mine", "towns": (*card.towns, town)}),
    )
    assert main(["test-detector", "mine/weights.safetensors", *ANALYTIC]) == 2
    assert (
        "version 'mine' was trained on the town of held-out F1star, so its failures there prove "
        "nothing" in capfd.readouterr().err
    )


def test_unnecessary_braking_is_printed_for_the_scenarios_that_ask_for_it(tmp_path: Path) -> None:
    config = compose("default", [*OVERRIDES, "search=[F1,N1]", "aeb.gate=detections"])
    study = FabricatedStudy(tmp_path, config).make()
    study.run("measure")
    for name in config.search:
        study.run("cluster", version="base", scenario=name)
    with chdir(tmp_path):
        lines = test_detector.table(
            config.model_copy(update={"tested": {"base": "base.onnx"}})
        ).splitlines()
    start = lines.index("Unnecessary braking")
    assert [line.split()[:3] for line in lines[start + 4 : start + 6]] == [
        ["base", "N1", name] for name in config.strategies
    ]
    assert "unnecessary" in lines[0] and lines[start + 6] == ""


def test_detectors_of_one_name_are_told_apart_by_content(tmp_path: Path) -> None:
    models = [tmp_path / "a" / "best.onnx", tmp_path / "b" / "best.onnx"]
    for path, content in zip(models, (b"one", b"another"), strict=True):
        path.parent.mkdir()
        path.write_bytes(content)
    chosen = compose("default", [])
    studies = {test_detector.study_of([path], chosen).study for path in models}
    assert studies == {"best-7692c3ad", "best-ae448ac8"}
    together = test_detector.study_of(models, chosen)
    assert list(together.tested) == ["best_7692", "best_ae44"]
    with pytest.raises(
        InputError,
        match=r"^expected different detectors, got .*best\.onnx, .*best\.onnx with the same "
        r"content$",
    ):
        test_detector.study_of([models[0], models[0]], chosen)


def test_the_path_of_a_file_may_look_like_an_override(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = yolov8()
    output[0, 4, 3] = np.nan
    (folder / "lr=0.01").mkdir()
    path = export(folder / "lr=0.01/broken.onnx", output)
    assert main(["test-detector", str(path), *SMALL]) == 2
    assert "broken.onnx returns values that are not finite" in capsys.readouterr().err


def test_a_function_needs_no_file_and_random_testing_alone_is_enough(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "blind_function.py").write_text("def detect(image):\n    return [], []\n")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{folder}")
    monkeypatch.syspath_prepend(folder)
    words = [
        "detector=function",
        "detector.function=blind_function.detect",
        "strategies=[random]",
        "simulator=analytic",
    ]
    assert main(["test-detector", *SMALL, *words]) == 0
    (study,) = (
        path for path in (folder / "data").iterdir() if path.name.startswith("blind_function")
    )
    (row,) = read(study / "measures.json", Measures).strategies
    assert (row.strategy, row.tests) == ("random", 6)


def test_a_builtin_function_has_no_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["test-detector", *SMALL, "detector=function", "detector.function=math.sqrt"]) == 2
    assert (
        "detector.function: expected a function of a Python file, got 'math.sqrt'"
        in capsys.readouterr().err
    )


def test_a_model_that_gives_no_numbers_is_refused_before_any_test(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = yolov8()
    output[0, 4, 3] = np.nan
    path = export(folder / "broken.onnx", output)
    assert main(["test-detector", str(path), *SMALL]) == 2
    assert "broken.onnx returns values that are not finite" in capsys.readouterr().err
    assert not (folder / "data").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.onnx"], "nowhere.onnx: expected the ONNX file of a detector, found no file"),
        (["model.pt"], "a .pt file can run code when read, so it is not opened"),
        (["mine.onnx", "campaign.testss=3"], "unknown key 'campaign.testss'"),
        (["campaign.tests=3"], "name the file of a detector, as in `test-detector best.onnx`"),
        (
            ["mine.onnx", "detector.layout=yolov3"],
            "detector.layout: expected 'boxes_scores', 'yolov5', 'yolov8' or 'end_to_end'",
        ),
        (["mine.onnx", "detector.person=car2"], "expected a class called car2 among its 3 classes"),
    ],
)
def test_bad_input_is_named(
    words: list[str], message: str, model: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at = str(model) if words[0] == "mine.onnx" else words[0]
    assert main(["test-detector", at, *SMALL, *words[1:]]) == 2
    assert message in capsys.readouterr().err
