"""`test-detector` runs a study's campaigns against a foreign detector, goes on where it was, and names what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.__main__ import main
from pipeline.artefacts.results import Measures, read
from pipeline.commands import test_detector
from pipeline.steps import campaign
from tests.detectors.test_layouts import export, yolov8

SMALL = ["campaign.tests=6", "search=[F1]", "seeds=[0]", "simulator=analytic", "samplers.neural.batch_size=3", "detector.threshold=0.5"]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export(tmp_path_factory.mktemp("model") / "mine.onnx", yolov8())


def test_campaigns_measures_and_regions(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "mine"
    words = ["test-detector", str(model), *SMALL, "--out", str(out)]
    assert main(words) == 0
    text = capsys.readouterr().out
    assert "failure rate" in text and "F1        random" in text and "F1        neural" in text
    measures = read(out / "measures.json", Measures)
    assert [row.tests for row in measures.strategies] == [6, 6]
    tests = pd.read_parquet(out / "campaigns/F1/random/base/0/tests.parquet")
    assert len(tests) == 6 and (out / "regions" / "F1.json").is_file()
    # Said again, nothing is executed again.
    changed = (out / "campaigns/F1/random/base/0/tests.parquet").stat().st_mtime_ns
    assert main(words) == 0
    assert (out / "campaigns/F1/random/base/0/tests.parquet").stat().st_mtime_ns == changed
    # By another program it is.
    monkeypatch.setattr(test_detector, "program_sha256", lambda: "another")
    assert main(words) == 0
    assert (out / "campaigns/F1/random/base/0/tests.parquet").stat().st_mtime_ns != changed
    stamp = out / "campaigns/F1/random/base/0/stamp"
    monkeypatch.setattr(campaign, "run", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        main([*words[:2], "campaign.tests=7", *words[3:]])
    assert not stamp.exists(), "a stamp of other settings must not vouch for what a kill left half written"
    monkeypatch.undo()
    assert main([*words[:2], "campaign.tests=7", *words[3:]]) == 0
    assert len(pd.read_parquet(out / "campaigns/F1/random/base/0/tests.parquet")) == 7


def test_two_models_of_one_name_have_folders_of_their_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    models = [tmp_path / "a" / "best.onnx", tmp_path / "b" / "best.onnx"]
    for path, content in zip(models, (b"one", b"another"), strict=True):
        path.parent.mkdir()
        path.write_bytes(content)
    folders = {test_detector.default_folder(path) for path in models}
    assert len(folders) == 2 and {folder.name[:5] for folder in folders} == {"best-"}


def test_a_model_that_gives_no_numbers_is_refused_before_any_test(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = yolov8()
    output[0, 4, 3] = np.nan
    path = export(tmp_path / "broken.onnx", output)
    assert main(["test-detector", str(path), *SMALL, "--out", str(tmp_path / "out")]) == 2
    assert "broken.onnx returns values that are not finite" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.onnx"], "nowhere.onnx: expected the ONNX file of a detector, found no file"),
        (["model.pt"], "a .pt file can run code when read, so it is not opened"),
        (["mine.onnx", "campaign.testss=3"], "unknown key 'campaign.testss'"),
        (["mine.onnx", "--threads", "0"], "--threads must be at least 1, got 0"),
        (["mine.onnx", "detector.layout=yolov3"], "detector.layout must be one of boxes_scores, yolov5, yolov8, end_to_end, got 'yolov3'"),
        (["mine.onnx", "detector.person=car2"], "expected a class called car2 among its 3 classes"),
    ],
)
def test_bad_input_is_named(words: list[str], message: str, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    at = str(model if words[0] == "mine.onnx" else tmp_path / words[0])
    assert main(["test-detector", at, *SMALL, *words[1:], "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
