"""Step `retrain`: the versions that learn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.artefacts.dataset import TRUTH_FILE, Record, image_set, write_image, write_truth
from pipeline.artefacts.model_card import write_card
from pipeline.config.composing import compose
from pipeline.contract import Job
from pipeline.core.truth import Truth
from pipeline.detectors.yolo.retraining import ImageSets
from pipeline.detectors.yolo.training import Run
from pipeline.learning import fitting, versions
from pipeline.progress import Progress
from pipeline.steps import retrain
from tests.cards import CARD
from tests.data_sets import scene


def control(root: Path, version: str) -> Job:
    """A job that trains a version of a control on two images."""
    worlds = {"town": "a", "people": "b"}
    write_image(root, "train", 0, np.zeros((32, 64, 3), np.uint8), Truth())
    write_image(root, "val", 1, np.zeros((32, 64, 3), np.uint8), Truth())
    write_truth(
        root,
        [Record("train", 0, 64, 32, Truth(), worlds), Record("val", 1, 64, 32, Truth(), worlds)],
    )
    write_card(root / "model.json", CARD)
    (root / "weights").write_bytes(b"")
    names = {"truth": TRUTH_FILE, "weights": "weights", "parent": "model.json"}
    reads = {"spaces": [], **{name: str(root / file) for name, file in names.items()}}
    return Job(
        compose("default", []),
        {"version": version},
        reads,
        {"card": "new.json"},
        1,
        Progress("retrain"),
        root,
    )


def test_a_later_round_learns_from_other_batches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeds: list[tuple[int, ...]] = []
    monkeypatch.setattr(
        fitting, "fit_version", lambda config, weights, images, seed, run: seeds.append(seed)
    )
    monkeypatch.setattr(versions, "write_version", lambda *_: None)
    for version in ("control-s4", "control-r2-s4", "control-r3-s4"):
        retrain.run(control(tmp_path, version))
    assert seeds == [(4,), (4, 2), (4, 3)]


def test_training_from_scratch_uses_all_added_frames_and_never_stops_early(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: list[Any] = []
    monkeypatch.setattr(fitting, "train_from_scratch", lambda *arguments: given.extend(arguments))
    base, added = (
        image_set([scene((60, 30, 64, 40), pixels=11), scene(None)], name)
        for name in ("base", "added")
    )
    config = compose("default", ["retraining.start=scratch"])
    fitting.fit_version(
        config, Path("no weights"), ImageSets(base, added, base), (7, 2), Run(threads=1)
    )
    images, indices, validation, settings, _ = given
    assert (len(images), indices.tolist(), validation.digest) == (4, [1, 2, 3], "base")
    assert settings["seed"] == 7
    assert (
        settings["patience"]
        >= (settings["crop_iterations"] + settings["frame_iterations"]) / settings["validate_every"]
    )
