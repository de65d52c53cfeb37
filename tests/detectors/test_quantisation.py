"""The int8 form gives the same detections as the original."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest

from pipeline.__main__ import main
from pipeline.artefacts.dataset import TRUTH_FILE, Record, Split, write_image, write_truth
from pipeline.core.truth import Truth
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.quantisation import quantise
from pipeline.detectors.yolo.export import export_onnx
from pipeline.detectors.yolo.network import Architecture, Yolo
from pipeline.detectors.yolo.training import initial_model
from tests.detectors.networks import spread_scores
from tests.studies import ROOT


def test_quantisation_keeps_scores_and_stores_8_bit_convolutions(tmp_path: Path) -> None:
    whole, small = tmp_path / "whole.onnx", tmp_path / "int8.onnx"
    network = initial_model(3, lambda: Yolo(Architecture((8, 8, 12, 16, 16), 8))).eval()
    spread_scores(network)
    export_onnx(whole, network, (96, 64))
    images = np.random.default_rng(0).integers(0, 255, (12, 64, 96, 3), dtype=np.uint8)
    quantise(whole, images[:8], small)
    first, second = (
        OnnxDetector(path, threshold=0.001, iou=0.99).detect_images(images[8:])
        for path in (whole, small)
    )
    for exact, quantised in zip(first, second, strict=True):
        assert np.ptp(exact.scores) > 0.2, "equal scores would prove nothing"
        assert abs(len(exact.scores) - len(quantised.scores)) <= 3
        assert np.abs(exact.scores[:10] - quantised.scores[:10]).mean() < 0.1
    model = onnx.load(str(small))
    weights = {tensor.name: tensor.data_type for tensor in model.graph.initializer}
    assert sum(kind == onnx.TensorProto.INT8 for kind in weights.values()) > 10


def test_the_command_writes_the_int8_form_and_prints_the_metrics_of_both(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    records, splits, rng = [], list[Split](["train", "train", "val"]), np.random.default_rng(0)
    for index, split in enumerate(splits):
        write_image(
            tmp_path, split, index, rng.integers(0, 255, (192, 320, 3), dtype=np.uint8), Truth()
        )
        records.append(Record(split, index, 320, 192, Truth(), {"town": "a", "people": "b"}))
    write_truth(tmp_path, records)
    out = tmp_path / "int8.onnx"
    words = [
        "--model",
        str(ROOT / "models/uniform"),
        "--base-set",
        str(tmp_path / TRUTH_FILE),
        "--out",
        str(out),
    ]
    assert main(["quantise", *words]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in printed[1:3]] == ["float32", "int8"] and printed[
        3
    ].startswith("on 1 validation images")
    assert any(
        tensor.data_type == onnx.TensorProto.INT8
        for tensor in onnx.load(str(out)).graph.initializer
    )


def test_images_of_another_camera_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for index, split in enumerate(list[Split](["train", "val"])):
        write_image(tmp_path, split, index, np.zeros((96, 160, 3), np.uint8), Truth())
    splits = list[Split](["train", "val"])
    write_truth(
        tmp_path,
        [
            Record(split, i, 160, 96, Truth(), {"town": "a", "people": "b"})
            for i, split in enumerate(splits)
        ],
    )
    assert (
        main(["quantise", "--model", str(ROOT / "models/uniform"), "--base-set", str(tmp_path)])
        == 2
    )
    assert "--base-set: expected images of (320, 192) px" in capsys.readouterr().err
