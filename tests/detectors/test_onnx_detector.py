from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper

from pipeline.config.components import make_detector
from pipeline.core.boxes import iou
from pipeline.core.episode import Frame
from pipeline.core.reliability import Calibration
from pipeline.core.truth import Truth
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import Deployed, export_onnx
from pipeline.detectors.yolo.network import Architecture, Yolo
from pipeline.detectors.yolo.training import initial_model
from pipeline.errors import InputError
from pipeline.protocols import Detector
from tests.detectors.networks import spread_scores

SIZE = (96, 64)


@pytest.fixture(scope="module")
def network() -> Yolo:
    network = initial_model(3, lambda: Yolo(Architecture((8, 8, 12, 16, 16), 8))).eval()
    spread_scores(network)
    return network


@pytest.fixture(scope="module")
def file(network: Yolo, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.onnx"
    export_onnx(path, network, SIZE)
    return path


def images(count: int) -> np.ndarray[tuple[int, int, int, int], np.dtype[np.uint8]]:
    return np.random.default_rng(0).integers(0, 255, (count, SIZE[1], SIZE[0], 3), dtype=np.uint8)


def test_the_detector_finds_what_the_network_finds(network: Yolo, file: Path) -> None:
    with torch.inference_mode():
        boxes, scores = Deployed(network, SIZE, Calibration())(torch.from_numpy(images(1)))
    detections = OnnxDetector(file, float(scores.min()) / 2, iou=0.999).detect_images(images(1))[0]
    assert len(detections.scores) == scores.numel()
    assert detections.scores == pytest.approx(
        scores[0].sort(descending=True).values.numpy(), abs=1e-4
    )
    assert np.sort(detections.boxes, axis=0) == pytest.approx(
        boxes[0].sort(0).values.numpy(), abs=1e-2
    )


def test_duplicates_are_suppressed(file: Path) -> None:
    detections = OnnxDetector(file, threshold=0.001, iou=0.3).detect_images(images(1))[0]
    overlaps = iou(detections.boxes, detections.boxes)
    assert len(detections.boxes) > 1
    assert (overlaps - np.eye(len(overlaps)) <= 0.3 + 1e-6).all()
    assert (np.diff(detections.scores) <= 0).all()


def test_images_one_by_one_and_together_agree(file: Path) -> None:
    detector = OnnxDetector(str(file), threshold=0.005)
    together = detector.detect_images(images(3))
    for image, detections in zip(images(3), together, strict=True):
        alone = detector.detect(Frame(image, Truth()))
        assert alone.scores == pytest.approx(detections.scores, abs=1e-4)


def test_without_scores_above_the_threshold_there_are_no_detections(file: Path) -> None:
    detector = OnnxDetector(file, threshold=0.99)
    assert isinstance(detector, Detector)
    assert len(detector.detect(Frame(images(1)[0], Truth())).boxes) == 0


def test_the_same_weights_give_the_same_file(network: Yolo, file: Path, tmp_path: Path) -> None:
    export_onnx(tmp_path / "again.onnx", network, SIZE)
    assert (tmp_path / "again.onnx").read_bytes() == file.read_bytes()


def test_the_calibration_is_inside_the_file(network: Yolo, file: Path, tmp_path: Path) -> None:
    calibration = Calibration(slope=1.5, offset=2.0)
    export_onnx(tmp_path / "calibrated.onnx", network, SIZE, calibration)
    plain, calibrated = (
        OnnxDetector(path, 0.001, iou=0.999).detect_images(images(1))[0]
        for path in (file, tmp_path / "calibrated.onnx")
    )
    assert calibrated.scores == pytest.approx(calibration.apply(plain.scores), abs=1e-4)
    # Rounding may swap boxes with nearly equal scores.
    assert np.sort(calibrated.boxes, axis=0) == pytest.approx(
        np.sort(plain.boxes, axis=0), abs=1e-3
    )


def test_another_image_size_is_refused(file: Path) -> None:
    with pytest.raises(
        InputError, match=r"takes uint8 images of \(64, 96, 3\), got uint8 \(32, 96, 3\)"
    ):
        OnnxDetector(file).detect_images(images(1)[:, :32])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"threshold": 0}, "detector.threshold: expected more than 0, got 0"),
        ({"threshold": 1.5}, "detector.threshold: expected less than 1, got 1.5"),
        ({"iou": 1}, "detector.iou: expected less than 1, got 1"),
        ({"threads": 0}, "detector.threads: expected at least 1, got 0"),
    ],
)
def test_wrong_settings_are_named(file: Path, wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_detector({"_target_": "pipeline.detectors.onnx.OnnxDetector", **wrong}, file)


def test_missing_and_damaged_files_are_named(file: Path, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"none\.onnx: expected the ONNX file of a detector, found no file"
    ):
        OnnxDetector(tmp_path / "none.onnx")
    broken = tmp_path / "broken.onnx"
    for data in (b"", b"no model", file.read_bytes()[:2000]):
        broken.write_bytes(data)
        with pytest.raises(InputError, match=r"^ONNX Runtime cannot load .*broken\.onnx: "):
            OnnxDetector(broken)


def test_weights_in_another_file_are_refused_until_they_are_inside(
    file: Path, tmp_path: Path
) -> None:
    path = tmp_path / "best.onnx"
    onnx.save(
        onnx.load(file),
        path,
        save_as_external_data=True,
        location="best.onnx.data",
        size_threshold=0,
    )
    with pytest.raises(
        InputError,
        match=r"best\.onnx: expected one file, but its weights are in best\.onnx\.data;"
        " put them into it: ",
    ) as error:
        OnnxDetector(path)
    command = str(error.value).partition("put them into it: ")[2]
    subprocess.run(["bash", "-c", command.replace("python", sys.executable, 1)], check=True)
    (tmp_path / "best.onnx.data").unlink()
    joined, whole = (OnnxDetector(each, 0.001).detect_images(images(1))[0] for each in (path, file))
    assert np.array_equal(joined.scores, whole.scores) and len(whole.scores)


@pytest.mark.parametrize("inside", ["a branch", "a node"])
def test_weights_in_another_file_are_found_wherever_the_graph_has_them(
    inside: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # ONNX Runtime looks for a branch's weights here.
    weights = numpy_helper.from_array(np.zeros((4, 4), np.float32), "weights")
    output = helper.make_tensor_value_info("out", TensorProto.FLOAT, [4, 4])
    node = helper.make_node("Constant", [], ["out"], value=weights)
    if inside == "a branch":
        branch = helper.make_graph(
            [helper.make_node("Identity", ["weights"], ["out"])], "branch", [], [output], [weights]
        )
        node = helper.make_node("If", ["yes"], ["out"], then_branch=branch, else_branch=branch)
    yes = numpy_helper.from_array(np.array(True), "yes")
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, 4, 4])
    graph = helper.make_graph([node], "graph", [image], [output], [yes])
    model, path = (
        helper.make_model(graph, ir_version=10, opset_imports=[helper.make_opsetid("", 17)]),
        tmp_path / "best.onnx",
    )
    onnx.save(model, path, save_as_external_data=True, location="best.data", size_threshold=10)
    with pytest.raises(
        InputError, match=r"best\.onnx: expected one file, but its weights are in best\.data"
    ):
        OnnxDetector(path)


@pytest.mark.parametrize(
    ("name", "kind", "rank"),
    [
        ("x", TensorProto.UINT8, 4),
        ("image", TensorProto.FLOAT, 4),
        ("image", TensorProto.UINT8, 3),
        ("image", TensorProto.UINT8, 4),
    ],
)
def test_other_networks_are_refused(tmp_path: Path, name: str, kind: int, rank: int) -> None:
    value = helper.make_tensor_value_info(name, kind, [1] * rank)
    result = helper.make_tensor_value_info("y", kind, [1] * rank)
    graph = helper.make_graph(
        [helper.make_node("Identity", [name], ["y"])], "other", [value], [result]
    )
    onnx.save(
        helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8),
        tmp_path / "other.onnx",
    )
    with pytest.raises(InputError, match=r"other\.onnx must have input 'image'"):
        OnnxDetector(tmp_path / "other.onnx")
