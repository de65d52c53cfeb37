"""Foreign ONNX detectors: recognised layouts, boxes scaled back to the image, named errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from pipeline.core.episode import Frame
from pipeline.core.truth import Truth
from pipeline.detectors.layouts import Layout, Letterbox, class_names, recognise
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.suppression import CANDIDATES, reported
from pipeline.errors import InputError, SimulationError
from pipeline.testing import check_detector
from tests.onnx_models import HEIGHT, WIDTH, end_to_end, export, yolov5, yolov8

IMAGE = np.zeros((HEIGHT, WIDTH, 3), np.uint8)


@pytest.mark.parametrize(("make", "score"), [(yolov8, 0.9), (yolov5, 0.855), (end_to_end, 0.9)])
def test_each_layout_is_recognised_and_gives_the_one_person(
    make: object, score: float, tmp_path: Path
) -> None:
    detector = OnnxDetector(export(tmp_path / "model.onnx", make()), 0.5)  # type: ignore[operator]
    detections = detector.detect(Frame(IMAGE, Truth()))
    assert detections.boxes == pytest.approx(np.array([[40, 30, 60, 70]]), abs=1e-3)
    assert detections.scores == pytest.approx([score], abs=1e-5)
    check_detector(detector, WIDTH, HEIGHT)


def test_boxes_come_back_through_scale_and_padding(tmp_path: Path) -> None:
    detector = OnnxDetector(export(tmp_path / "model.onnx", yolov8()), 0.5)
    # 320 x 160 is halved to 160 x 80 and padded by 8 rows above and below.
    detections = detector.detect(Frame(np.zeros((160, 320, 3), np.uint8), Truth()))
    assert detections.boxes == pytest.approx(np.array([[80, 44, 120, 124]]), abs=1e-3)


def test_a_letterbox_keeps_proportions() -> None:
    image = np.full((50, 100, 3), 200, np.uint8)
    padded, box = Letterbox.fit(image, 64, 64)
    assert (
        padded.shape == (64, 64, 3) and (padded[:16] == 114).all() and (padded[16:48] == 200).all()
    )
    assert box.back(np.array([[0, 16, 64, 48]], np.float32)) == pytest.approx(
        np.array([[0, 0, 100, 50]])
    )


@pytest.mark.parametrize(
    ("shape", "layout"),
    [
        ((1, 84, 8400), "yolov8"), ((1, 5, 8400), "yolov8"), ((1, 25200, 85), "yolov5"),
        ((1, 25200, 6), "yolov5"), ((1, 300, 6), "end_to_end"), (("batch", "n", 6), None),
        ((1, 8400, 84), None), ((1, 84), None), ((1, "a", "b"), None),
    ],
)  # fmt: skip
def test_shapes_identify_layouts(shape: tuple[int | str, ...], layout: str | None) -> None:
    assert recognise(shape, 640, 640) == layout


def test_a_person_may_have_any_number_or_be_declared(tmp_path: Path) -> None:
    other = yolov8()[:, [0, 1, 2, 3, 5, 4, 6]]
    named = OnnxDetector(
        export(tmp_path / "a.onnx", other, "{0: 'bicycle', 1: 'Pedestrian', 2: 'car'}"), 0.5
    )
    declared = OnnxDetector(export(tmp_path / "b.onnx", other, None), 0.5, person=1)
    for detector in (named, declared):
        assert len(detector.detect(Frame(IMAGE, Truth())).scores) == 1
    assert (
        len(
            OnnxDetector(export(tmp_path / "c.onnx", yolov8(1), None), 0.5)
            .detect(Frame(IMAGE, Truth()))
            .scores
        )
        == 1
    )


def test_a_layout_may_be_declared_if_the_shape_is_ambiguous(tmp_path: Path) -> None:
    turned = export(tmp_path / "a.onnx", yolov8().transpose(0, 2, 1))
    with pytest.raises(
        InputError,
        match=r"cannot recognise the layout .*; set detector.layout to one of"
        " yolov5, yolov8, end_to_end$",
    ):
        OnnxDetector(turned)
    detector = OnnxDetector(export(tmp_path / "b.onnx", end_to_end()), layout="end_to_end")
    assert len(detector.detect(Frame(IMAGE, Truth())).scores) == 1


@pytest.mark.parametrize(
    ("output", "layout"),
    [
        (yolov8().transpose(0, 2, 1), "yolov8"),
        (yolov8().transpose(0, 2, 1), "end_to_end"),
        (yolov8(), "yolov5"),
        (yolov5(), "yolov8"),
        (yolov8(), "end_to_end"),
    ],
)
def test_a_layout_that_the_output_cannot_have_is_refused(
    output: np.ndarray, layout: Layout, tmp_path: Path
) -> None:
    with pytest.raises(
        InputError,
        match=rf"detector.layout is {layout}, but an output \[1, \d+, \d+\]"
        " cannot have this layout$",
    ):
        OnnxDetector(export(tmp_path / "a.onnx", output), layout=layout)


def test_a_fixed_batch_is_refused(tmp_path: Path) -> None:
    path = export(tmp_path / "a.onnx", yolov8())
    model = onnx.load(path)
    model.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 2
    onnx.save(model, path)
    with pytest.raises(
        InputError, match=r"a.onnx takes batches of 2 images; export it for one image"
    ):
        OnnxDetector(path)


def test_the_class_of_a_person_is_found_in_any_letter_case(tmp_path: Path) -> None:
    assert (
        len(
            OnnxDetector(
                export(tmp_path / "a.onnx", yolov8(), "{0: 'Person', 1: 'b', 2: 'c'}"),
                person="Person",
            )
            .detect(Frame(IMAGE, Truth()))
            .boxes
        )
        == 1
    )


def test_wrong_settings_are_named(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match="expected a class called pedestrian or person or people among its 3 classes,"
        " got names 0: cat",
    ):
        OnnxDetector(export(tmp_path / "a.onnx", yolov8(), "{0: 'cat', 1: 'dog', 2: 'car'}"))
    with pytest.raises(InputError, match=r"detector.person must be in \[0, 3\), got 7"):
        OnnxDetector(export(tmp_path / "b.onnx", yolov8()), person=7)
    hostile = tmp_path / "best.pt"
    hostile.write_bytes(b"\x80\x04cos\nsystem\n.")
    with pytest.raises(
        InputError,
        match=r"a .pt file can run code when read, so it is not opened; export it to ONNX",
    ):
        OnnxDetector(hostile)


def test_names_that_do_not_fit_the_output_are_named(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"its metadata name class 7 person, but its output has only 3 classes \(0 to 2\)",
    ):
        OnnxDetector(export(tmp_path / "a.onnx", yolov8(), "{7: 'person'}"))
    with pytest.raises(InputError, match="got names none"):
        OnnxDetector(export(tmp_path / "b.onnx", yolov8(), "{'a': 'person'}"))


def test_a_tiny_box_of_a_person_among_boxes_in_pixels_is_no_sign_of_relative_boxes(
    tmp_path: Path,
) -> None:
    output = end_to_end()
    output[0, :, 5] = 2
    output[0, 0] = [0.2, 0.1, 1.6, 1.9, 0.01, 0]
    assert not len(
        OnnxDetector(export(tmp_path / "a.onnx", output), 0.5).detect(Frame(IMAGE, Truth())).scores
    )


@pytest.mark.parametrize("make", [yolov8, yolov5, end_to_end])
def test_logits_and_relative_boxes_are_refused(make: Any, tmp_path: Path) -> None:
    logits = make()
    logits[logits == np.float32(0.9)] = 7.3
    with pytest.raises(
        SimulationError,
        match=r"returns a score of [67]\.\d+, expected scores in \[0, 1\];"
        " apply a sigmoid to logits",
    ):
        OnnxDetector(export(tmp_path / "a.onnx", logits)).detect(Frame(IMAGE, Truth()))
    shares = make()
    shares[shares > 1] /= 160
    with pytest.raises(
        InputError,
        match=r"b.onnx: expected boxes in pixels of its 160 by 96 input, got none beyond",
    ):
        OnnxDetector(export(tmp_path / "b.onnx", shares)).detect(Frame(IMAGE, Truth()))


def test_a_file_that_onnx_runtime_cannot_run_is_named(tmp_path: Path) -> None:
    path = export(tmp_path / "a.onnx", yolov8())
    model = onnx.load(path)
    model.graph.node[3].op_type = "BitShift"
    onnx.save(model, path)
    with pytest.raises(InputError, match=r"ONNX Runtime cannot load .*a.onnx: "):
        OnnxDetector(path)
    breaking = export(tmp_path / "b.onnx", yolov8())
    model = onnx.load(breaking)
    for side in model.graph.input[0].type.tensor_type.shape.dim[2:]:
        side.dim_param = "side"
    shape = helper.make_node("Reshape", ["images", "three"], ["wrong"])
    model.graph.initializer.append(numpy_helper.from_array(np.array([7, -1]), "three"))
    model.graph.node.insert(0, shape)
    model.graph.output.append(helper.make_tensor_value_info("wrong", TensorProto.FLOAT, ["a", "b"]))
    onnx.save(model, breaking)
    with pytest.raises(SimulationError, match=r"b.onnx failed on an image: .*Reshape"):
        OnnxDetector(breaking, layout="yolov8").detect(Frame(IMAGE, Truth()))


def test_class_names_are_never_executed(tmp_path: Path) -> None:
    path = export(
        tmp_path / "a.onnx",
        yolov8(),
        f"__import__('pathlib').Path({str(tmp_path / 'ran')!r}).touch()",
    )
    with pytest.raises(InputError, match="got names none"):
        OnnxDetector(path)
    assert not (tmp_path / "ran").exists()


def test_class_names_that_nest_too_deeply_are_none() -> None:
    assert class_names({"names": "-" * 20_000 + "1"}) == {}


def test_class_names_with_an_infinite_number_are_none() -> None:
    assert class_names({"names": "{1e999: 'person'}"}) == {}


def final() -> np.ndarray:
    """The same street in an end-to-end output: left, top, right, bottom, score, class."""
    output = np.zeros((1, 300, 6), np.float32)
    output[0, 0] = [40, 30, 60, 70, 0.9, 0]
    return output


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("output", "where"),
    [(yolov8(), (0, 4, 3)), (yolov8(), (0, 1, 7)), (final(), (0, 0, 2)), (final(), (0, 0, 5))],
)
def test_non_finite_values_are_an_error(
    output: np.ndarray, where: tuple[int, int, int], value: float, tmp_path: Path
) -> None:
    output = output.copy()
    output[where] = value
    with pytest.raises(SimulationError, match="returns values that are not finite"):
        OnnxDetector(export(tmp_path / "a.onnx", output), 0.5).detect(Frame(IMAGE, Truth()))


def test_a_score_at_the_threshold_is_reported() -> None:
    box = np.array([[0, 0, 9, 9]], np.float32)
    assert [
        len(reported("it", box, np.array([0.5], np.float32), threshold, 0.45).scores)
        for threshold in (0.5, 0.51)
    ] == [1, 0]


def test_of_too_many_boxes_the_best_are_reported() -> None:
    left = np.arange(CANDIDATES + 20, dtype=np.float32) * 10
    boxes, scores = (
        np.column_stack([left, 0 * left, left + 9, 0 * left + 9]),
        np.linspace(0.1, 0.9, CANDIDATES + 20, dtype=np.float32),
    )
    assert (
        reported("it", boxes, scores, 0.05, 0.45).scores.tolist()
        == sorted(scores.tolist(), reverse=True)[:CANDIDATES]
    )
