"""Detectors of other libraries keep the contract; unsuitable files are refused by name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from transformers import YolosConfig, YolosForObjectDetection, YolosImageProcessorPil

from pipeline.config.components import make_detector
from pipeline.core.episode import Frame
from pipeline.core.truth import Truth
from pipeline.detectors.function import FunctionDetector
from pipeline.detectors.hugging_face import HuggingFaceDetector
from pipeline.detectors.ultralytics import UltralyticsDetector
from pipeline.errors import InputError, SimulationError
from pipeline.testing import check_detector

IMAGE = np.random.default_rng(0).integers(0, 255, (192, 320, 3), dtype=np.uint8)


def save(folder: Path, person: str = "person", broken: bool = False, half: bool = False) -> Path:
    """A tiny model with random weights, saved as a user would save it."""
    torch.manual_seed(0)
    names = {0: "car", 1: person, 2: "tree"}
    config = YolosConfig(
        hidden_size=32,
        num_hidden_layers=1,
        num_attention_heads=2,
        intermediate_size=32,
        image_size=[192, 320],
        patch_size=32,
        num_detection_tokens=8,
        id2label=names,
        label2id={name: number for number, name in names.items()},
    )
    network = YolosForObjectDetection(config)
    with torch.no_grad():
        bias = network.class_labels_classifier.layers[-1].bias
        bias.copy_(torch.tensor([0.0, torch.nan if broken else 4.0, 0.0, 0.0]))
    (network.half() if half else network).save_pretrained(folder)
    YolosImageProcessorPil(size={"height": 192, "width": 320}).save_pretrained(folder)
    return folder


def test_a_hugging_face_model_keeps_the_contract(tmp_path: Path) -> None:
    detector = HuggingFaceDetector(save(tmp_path / "model"), threshold=0.3)
    check_detector(detector, 320, 192)
    detections = detector.detect(Frame(IMAGE, Truth()))
    assert len(detections.scores) >= 1 and detections.scores[0] > 0.9
    assert (
        len(
            HuggingFaceDetector(tmp_path / "model", threshold=0.3, person="tree")
            .detect(Frame(IMAGE, Truth()))
            .scores
        )
        == 0
    )


def test_a_hugging_face_model_in_half_precision_finds_the_same(tmp_path: Path) -> None:
    exact, half = (
        HuggingFaceDetector(save(tmp_path / str(half), half=half), threshold=0.3)
        for half in (False, True)
    )
    first, second = (detector.detect(Frame(IMAGE, Truth())) for detector in (exact, half))
    assert len(first.scores) and second.scores == pytest.approx(first.scores, abs=0.01)


def test_non_finite_hugging_face_values_raise_a_simulation_error(tmp_path: Path) -> None:
    detector = HuggingFaceDetector(save(tmp_path / "model", broken=True))
    with pytest.raises(SimulationError, match="returns values that are not finite"):
        detector.detect(Frame(IMAGE, Truth()))


def test_wrong_hugging_face_folders_are_named(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"expected a folder written by save_pretrained; config\.json is missing"
    ):
        HuggingFaceDetector(tmp_path)
    save(tmp_path / "other", person="wolf")
    with pytest.raises(
        InputError,
        match="expected a class called pedestrian or person or people among its 3 classes, "
        "got names 0: car",
    ):
        HuggingFaceDetector(tmp_path / "other")
    pickled = save(tmp_path / "pickled")
    (pickled / "model.safetensors").unlink()
    torch.save({}, pickled / "pytorch_model.bin")
    with pytest.raises(
        InputError,
        match=r"expected model\.safetensors, found pytorch_model\.bin, which can run code",
    ):
        HuggingFaceDetector(pickled)
    truncated = save(tmp_path / "truncated")
    weights = truncated / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:5000])
    with pytest.raises(InputError, match="Transformers cannot load .* as an object detector: "):
        HuggingFaceDetector(truncated)


def test_an_error_of_hugging_face_may_have_no_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise AssertionError

    folder = save(tmp_path / "model")
    monkeypatch.setattr("transformers.AutoImageProcessor.from_pretrained", fails)
    with pytest.raises(InputError, match="Transformers cannot load .* as an object detector"):
        HuggingFaceDetector(folder)


def test_an_ultralytics_checkpoint_is_not_read_unless_trusted(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a \.pt file can run code when read"):
        UltralyticsDetector(tmp_path / "best.pt")
    with pytest.raises(InputError, match="expected a detector file, found none"):
        UltralyticsDetector(tmp_path / "best.pt", trusted=True)


def test_ultralytics_gets_no_onnx_file_with_its_weights_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "best.onnx"
    weights = onnx.numpy_helper.from_array(np.ones(4, np.float32), "weights")
    graph = onnx.helper.make_graph([], "detector", [], [], [weights])
    onnx.save(
        onnx.helper.make_model(graph),
        path,
        save_as_external_data=True,
        location="best.onnx.data",
        size_threshold=0,
    )
    with pytest.raises(
        InputError, match=r"best\.onnx: expected one file, but its weights are in best\.onnx\.data"
    ):
        UltralyticsDetector(path)


def bright(image: Any) -> Any:
    rows, columns = np.nonzero(image.min(axis=2) > 200)
    if not len(rows):
        return [], []
    box = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
    image[:] = 0
    return [(0, 0, 30, 30), box], [0.6, 0.9]


def bad_shape(_image: Any) -> Any:
    return [(1, 2, 3)], [0.5]


def bad_score(_image: Any) -> Any:
    return [(1, 2, 30, 40)], [1.5]


def failing(_image: Any) -> Any:
    raise RuntimeError("no licence")


def test_a_function_keeps_the_contract() -> None:
    detector = FunctionDetector(f"{__name__}.bright")
    check_detector(detector, 320, 192)
    image = np.zeros((192, 320, 3), np.uint8)
    image[80:120, 100:120] = 250
    detections = detector.detect(Frame(image, Truth()))
    assert detections.boxes.tolist() == [[100, 80, 120, 120], [0, 0, 30, 30]] and image.max() == 250


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("bad_shape", r"must return boxes \(n, 4\) and scores \(n,\), got \(1, 3\) and \(1,\)"),
        ("bad_score", r"must return scores in \[0, 1\], got 1\.5 to 1\.5"),
        ("failing", "failed: RuntimeError: no licence"),
    ],
)
def test_a_wrong_function_raises_a_simulation_error(name: str, message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        FunctionDetector(f"{__name__}.{name}").detect(Frame(IMAGE, Truth()))


@pytest.mark.parametrize("threshold", [50, 0, -1])
def test_a_threshold_that_reports_all_or_nothing_is_refused(threshold: float) -> None:
    section = {
        "_target_": "pipeline.detectors.function.FunctionDetector",
        "function": f"{__name__}.bright",
        "threshold": threshold,
    }
    with pytest.raises(
        InputError, match=rf"detector\.threshold: expected (more|less) than \d, got {threshold}"
    ):
        make_detector(section, Path("none"))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nowhere.detect", "there is no 'nowhere.detect' (No module named 'nowhere')"),
        (
            f"{__name__}.missing",
            f"there is no '{__name__}.missing' (module '{__name__}' has no attribute 'missing')",
        ),
        ("detect", "there is no 'detect' (Empty module name)"),
        (f"{__name__}.IMAGE", f"expected a function, got '{__name__}.IMAGE' of type ndarray"),
    ],
)
def test_a_missing_function_is_an_input_error(name: str, message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(f'detector.function: {message}')}$"):
        FunctionDetector(name)
