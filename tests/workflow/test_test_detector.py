"""`test-detector` tests and compares any detectors, resumes, and names what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.__main__ import main
from pipeline.artefacts.comparison_results import Comparison
from pipeline.artefacts.results import Measures, read
from pipeline.commands import test_detector
from pipeline.config.composing import compose
from pipeline.errors import InputError
from tests.detectors.test_layouts import export, yolov8
from tests.studies import ROOT

SMALL = ["campaign.tests=6", "search=[F1]", "seeds=[0]", "comparison.tests=6", "samplers.neural.batch_size=3", "report.replays=2"]
ANALYTIC = [*SMALL, "simulator=analytic", "detector.threshold=0.5"]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export(tmp_path_factory.mktemp("model") / "mine.onnx", yolov8())


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the workflow's files, as a checkout has them."""
    for name in ("Snakefile", "profiles", "pipeline", "models"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return tmp_path


def test_two_detectors_are_tested_compared_and_shown(model: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = yolov8()
    output[0, 4:] /= 2
    export(folder / "ours.onnx", output)
    words = ["test-detector", "ours.onnx", str(model), *ANALYTIC]
    assert main(words) == 0
    text = capsys.readouterr().out
    (root,) = (folder / "data").iterdir()
    assert root.name.startswith("ours-") and f"Next: open data/{root.name}/reports/ours.html" in text
    measures = read(root / "measures.json", Measures)
    assert [(row.version, row.tests) for row in measures.strategies] == [(name, 6) for name in ("ours", "mine") for _ in range(2)]
    comparison = read(root / "comparison.json", Comparison)
    assert [(result.version, result.tests) for result in comparison.versions] == [("ours", 6), ("mine", 6)]
    assert (root / "regions/mine/F1.json").is_file()
    for name in ("ours", "mine"):
        page = (root / f"reports/{name}.html").read_text()
        assert "Failures found" in page and "Coverage of the scenario space" in page
        assert "Single-image detection" not in page, "nothing was trained"
    # Called again, nothing is executed again.
    table = root / "campaigns/F1/random/ours/0/tests.parquet"
    made = table.stat().st_mtime_ns
    assert main(words) == 0
    assert table.stat().st_mtime_ns == made and "failure rate" in capsys.readouterr().out


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
    with pytest.raises(InputError, match=r"^expected different detectors, got .*best\.onnx, .*best\.onnx with the same content$"):
        test_detector.study_of([models[0], models[0]], chosen)


def test_a_model_that_gives_no_numbers_is_refused_before_any_test(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
        (["mine.onnx", "--cores", "0"], "--cores must be at least 1, got 0"),
        (["campaign.tests=3"], "name the file of a detector, as in `test-detector best.onnx`"),
        (["mine.onnx", "detector.layout=yolov3"], "detector.layout must be one of boxes_scores, yolov5, yolov8, end_to_end, got 'yolov3'"),
        (["mine.onnx", "detector.person=car2"], "expected a class called car2 among its 3 classes"),
    ],
)
def test_bad_input_is_named(words: list[str], message: str, model: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    at = str(model) if words[0] == "mine.onnx" else words[0]
    assert main(["test-detector", at, *SMALL, *words[1:]]) == 2
    assert message in capsys.readouterr().err
