from __future__ import annotations

import copy
import io
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import nn

from pipeline.artefacts.dataset import ImageSet, image_set
from pipeline.artefacts.files import read_sealed
from pipeline.core.boxes import iou
from pipeline.core.truth import Truth
from pipeline.detectors.yolo import recipe, retraining, training
from pipeline.detectors.yolo.data import batch
from pipeline.detectors.yolo.network import Architecture, Yolo, cells, decode
from pipeline.detectors.yolo.recipe import RELIT_ALL, RELIT_FROM, relit_share, train_from_scratch
from pipeline.detectors.yolo.retraining import ImageSets, Refinement, crop_of, mixed_feed, retrain
from pipeline.detectors.yolo.training import (
    Batch,
    Fitted,
    Lesson,
    Run,
    Schedule,
    Validation,
    fit,
    initial_model,
)
from pipeline.errors import InputError
from tests.detectors.networks import small_network

SIZE = (96, 64)
MEAN = "stage4.0.1.running_mean"
ALONE = Run(threads=1)


def people(count: int, seed: int) -> ImageSet:
    """Red rectangles on noise; every fourth image is empty."""
    rng = np.random.default_rng(seed)
    scenes: list[tuple[NDArray[np.uint8], Truth]] = []
    for number in range(count):
        image = rng.integers(60, 120, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
        if number % 4 == 3:
            scenes.append((image, Truth()))
            continue
        height = int(rng.integers(16, 48))
        left, top = (
            int(rng.integers(0, SIZE[0] - height // 2)),
            int(rng.integers(0, SIZE[1] - height)),
        )
        box = (float(left), float(top), float(left + height // 2), float(top + height))
        image[top : top + height, left : left + height // 2] = (230, 40, 40)
        scenes.append((image, Truth(box, box, height * height // 2, height * height // 2, 60.0)))
    return image_set(scenes, f"people {count} {seed}")


def same(first: nn.Module, second: nn.Module) -> bool:
    other = second.state_dict()
    return all(torch.equal(value, other[name]) for name, value in first.state_dict().items())


def test_training_memorises_a_few_images() -> None:
    images = people(8, 0)

    def feed(iteration: int) -> Batch:
        return images.images, images.boxes

    model = fit(
        small_network(), Lesson(Schedule(0, 230, 4e-3, warm_up=10, averaging=0.95), feed), ALONE
    ).model
    scaled = torch.from_numpy(images.images).permute(0, 3, 1, 2).float() / 255
    with torch.inference_mode():
        boxes, logits = decode(model(scaled), *cells(*SIZE))
    scores, best = logits.sigmoid().max(1)
    shown = images.boxes[:, 2] > 0
    overlaps = [
        iou(boxes[i, best[i]][None].numpy(), images.boxes[i : i + 1])[0, 0]
        for i in np.flatnonzero(shown)
    ]
    assert np.mean(np.array(overlaps) > 0.5) > 0.8
    assert (
        scores[torch.from_numpy(shown)].mean() > 0.5 > 0.2 > scores[torch.from_numpy(~shown)].mean()
    )


@pytest.mark.parametrize("muon", [False, True])
def test_a_killed_training_reaches_the_same_weights(
    muon: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    images, schedule, checkpoint = (
        people(8, 1),
        Schedule(2, 5, 1e-3, warm_up=3, muon=muon),
        tmp_path / "checkpoint.pt",
    )
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    killed: list[int] = []

    def feed(iteration: int) -> Batch:
        rng = np.random.default_rng(iteration)
        chosen = rng.choice(len(images), 4)
        return images.images[chosen], images.boxes[chosen]

    def feed_until_killed(iteration: int) -> Batch:
        if iteration == 4 and not killed:
            killed.append(iteration)
            raise KeyboardInterrupt
        return feed(iteration)

    uninterrupted = fit(small_network(), Lesson(schedule, feed), ALONE).model
    with pytest.raises(KeyboardInterrupt):
        fit(small_network(), Lesson(schedule, feed_until_killed, "a"), Run(checkpoint, threads=1))
    done: list[int] = []
    counted = Run(checkpoint, 1, lambda now, *_: done.append(now))
    resumed = fit(small_network(), Lesson(schedule, feed, "a"), counted).model
    assert same(uninterrupted, resumed)
    assert done == [7]
    other = fit(small_network(), Lesson(schedule, feed, "b"), Run(checkpoint, threads=1)).model
    assert same(uninterrupted, other)
    monkeypatch.setattr(training, "program_sha256", lambda *_: "another")
    done.clear()
    fit(small_network(), Lesson(schedule, feed, "b"), counted)
    assert (
        done == [7]
        and torch.load(io.BytesIO(read_sealed(checkpoint)), weights_only=True)["identity"]
        == "banother"
    )
    for damaged in (b"damaged", b"", b"\x80", b"q\xff\x01.", b"K\x01."):
        checkpoint.write_bytes(damaged)
        assert same(
            uninterrupted,
            fit(small_network(), Lesson(schedule, feed, "a"), Run(checkpoint, threads=1)).model,
        )


@pytest.mark.parametrize(("size", "share"), [((320, 192), 1 / 4), ((640, 384), 1 / 16)])
def test_the_rate_follows_the_pixels_of_crops(
    size: tuple[int, int], share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    lessons: list[Lesson] = []
    monkeypatch.setattr(recipe, "fit", lambda model, lesson, run: lessons.append(lesson))
    monkeypatch.setattr(recipe, "initial_model", Mock())
    monkeypatch.setattr(recipe, "watching", Mock())
    monkeypatch.setattr(recipe, "hardness", lambda images, most: np.ones(1, int))
    numbers = dict.fromkeys(("seed", "batch_size", "oversampling", "validate_every", "patience"), 1)
    config = {**numbers, "crop_iterations": 1600, "frame_iterations": 400, "learning_rate": 1e-2}
    images: Any = Mock(size=size, digest="a")
    train_from_scratch(images, np.zeros(1, np.int64), images, config, ALONE)
    shown = 1600 * share / (1600 * share + 400)
    assert lessons[0].schedule.rate(1600) == pytest.approx(
        1e-2 * (0.01 + 0.99 * 0.5 * (1 + np.cos(np.pi * shown)))
    )


def test_schedule_warms_up_and_falls() -> None:
    schedule = Schedule(400, 100, 1e-2, warm_up=10)
    rates = [schedule.rate(iteration) for iteration in range(500)]
    assert rates[0] == pytest.approx(1e-3, rel=0.01)
    assert max(rates) == pytest.approx(1e-2, rel=0.01)
    assert rates[20:] == sorted(rates[20:], reverse=True)
    assert rates[-1] < 2e-4
    assert rates[400] == pytest.approx(
        1e-2 * (0.01 + 0.99 * 0.5), rel=0.01
    )  # Half of the pixels have been shown.


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"frame_iterations": 0}, "iterations must be at least 1 in all, got 0 and 0"),
        ({"crop_iterations": -1}, "iterations must be at least 1 in all, got -1 and 5"),
        ({"learning_rate": 0.0}, r"learning_rate must be in \(0, 1\), got 0\.0"),
        ({"averaging": 1.0}, r"averaging must be in \[0, 1\), got 1\.0"),
    ],
)
def test_schedule_checks_its_ranges(wrong: dict[str, Any], message: str) -> None:
    right: dict[str, Any] = {"crop_iterations": 0, "frame_iterations": 5, "learning_rate": 0.1}
    with pytest.raises(ValueError, match=f"^{message}$"):
        Schedule(**(right | wrong))


def test_frozen_statistics_do_not_change() -> None:
    model = small_network()
    before = model.state_dict()[MEAN].clone()
    images = people(4, 2)
    schedule = Schedule(0, 2, 1e-3, frozen_statistics=True)
    after = fit(model, Lesson(schedule, lambda _: (images.images, images.boxes)), ALONE).model
    assert torch.equal(before, after.state_dict()[MEAN])


def test_retraining_mixes_and_the_control_does_not() -> None:
    base, added = people(8, 3), people(8, 4)
    red_base = mixed_feed(base, None, 4, 0.5, (0,))
    mixed = mixed_feed(base, added, 4, 0.5, (0,))
    width, height = crop_of(SIZE)
    assert red_base(0)[0].shape == mixed(0)[0].shape == (4, height, width, 3)
    assert np.array_equal(mixed(3)[0], mixed(3)[0])
    assert np.array_equal(mixed(0)[0][:2], mixed_feed(base, people(8, 5), 4, 0.5, (0,))(0)[0][:2])
    assert not np.array_equal(
        mixed(0)[0][2:], mixed_feed(base, people(8, 5), 4, 0.5, (0,))(0)[0][2:]
    )
    assert not np.array_equal(mixed(0)[0], mixed_feed(base, added, 4, 0.5, (0, 2))(0)[0])


@pytest.mark.parametrize(
    ("size", "crop"), [((320, 192), (256, 160)), ((640, 384), (512, 320)), ((32, 32), (32, 32))]
)
def test_retraining_shows_large_crops(size: tuple[int, int], crop: tuple[int, int]) -> None:
    assert crop_of(size) == crop


def test_retraining_leaves_the_first_stage_as_it_is() -> None:
    images, parent = people(8, 6), small_network()
    trained = retrain(
        copy.deepcopy(parent),
        ImageSets(images, None, images),
        Refinement(2, 4, 1e-3, 0.5, (0,)),
        ALONE,
    ).model
    assert same(parent.stage4, trained.stage4) and not same(parent.stage8, trained.stage8)


def test_both_recipes_run_and_repeat(tmp_path: Path) -> None:
    images = people(8, 6)
    parent, sets, plan = (
        small_network(),
        ImageSets(images, people(4, 7), people(4, 9)),
        Refinement(2, 4, 1e-4, 0.5, (0,)),
    )
    versions = [
        retrain(copy.deepcopy(parent), sets, plan, Run(tmp_path / name, threads=1)) for name in "ab"
    ]
    assert same(versions[0].model, versions[1].model) and versions[0].curve == versions[1].curve
    assert [look.iteration for look in versions[0].curve] == [1, 2]
    assert not same(parent, versions[0].model)


def test_a_checkpoint_of_other_images_or_weights_is_ignored(tmp_path: Path) -> None:
    images, plan, run = (
        people(8, 6),
        Refinement(2, 4, 1e-3, 0.5, (0,)),
        Run(tmp_path / "c", threads=1),
    )
    other_weights = initial_model(1, lambda: Yolo(Architecture((8, 16, 16, 24, 32), 16)))
    for parent, added in (
        (small_network(), people(4, 7)),
        (small_network(), people(4, 8)),
        (other_weights, people(4, 8)),
    ):
        sets = ImageSets(images, added, images)
        assert same(
            retrain(copy.deepcopy(parent), sets, plan, run).model,
            retrain(copy.deepcopy(parent), sets, plan, ALONE).model,
        )


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ((1, 0, 1e-3, 0.5, (0,)), "batch_size must be at least 1, got 0"),
        ((1, 4, 1e-3, 1.5, (0,)), r"added_share must be in \[0, 1\], got 1.5"),
    ],
)
def test_a_plan_checks_its_ranges(
    plan: tuple[int, int, float, float, tuple[int]], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Refinement(*plan)


@pytest.mark.parametrize("iterations", [1, 3, 5])
def test_every_version_takes_all_its_steps(
    iterations: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def falling(_validation: ImageSet, every: int, patience: int) -> Validation:
        scores = iter((0.9, 0.5, 0.4, 0.3))
        return Validation(lambda _: next(scores), every, patience)

    monkeypatch.setattr(retraining, "watching", falling)
    images = people(8, 6)
    plan = Refinement(iterations, 4, 1e-3, 0.5, (0,))
    fitted = retrain(
        small_network(), ImageSets(images, None, images), plan, Run(tmp_path / "c", threads=1)
    )
    kept = small_network()
    kept.load_state_dict(torch.load(tmp_path / "c", weights_only=True)["average"])
    assert fitted.curve[-1].iteration == iterations and same(fitted.model, kept)


@pytest.mark.parametrize("iterations", [1, 3])
def test_the_average_contains_the_last_of_an_odd_number_of_steps(iterations: int) -> None:
    images, averages = people(4, 2), []
    for steps in (iterations - 1, iterations):
        model = small_network()
        if steps:
            model = fit(
                model,
                Lesson(
                    Schedule(0, steps, 1e-2, warm_up=0), lambda _: (images.images, images.boxes)
                ),
                ALONE,
            ).model
        averages.append(model)
    assert not same(*averages)


def test_a_checkpoint_of_other_images_is_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    identities: list[str] = []

    def kept(model: Yolo, lesson: Lesson, run: Run) -> Fitted:
        identities.append(lesson.identity)
        return Fitted(model, ())

    monkeypatch.setattr(recipe, "fit", kept)
    images = people(8, 4)
    for indices, validation in (
        ([0, 1], people(4, 5)),
        ([4, 5], people(4, 5)),
        ([0, 1], people(4, 6)),
    ):
        train_from_scratch(images, np.array(indices), validation, SCRATCH, ALONE)
    assert len(set(identities)) == 3


def test_every_added_frame_is_trained_on(tmp_path: Path) -> None:
    # The pedestrian is too small for the base set, but the filter or a person has accepted it.
    box = (10.0, 10.0, 12.0, 14.0)
    added = image_set(
        [(np.full((SIZE[1], SIZE[0], 3), 9, np.uint8), Truth(box, box, 8, 8, 60.0))] * 2
    )
    feed = mixed_feed(people(8, 3), added, 4, 0.5, (0,))
    boxes = np.concatenate([feed(iteration)[1][2:] for iteration in range(20)])
    assert (
        boxes[:, 2] > boxes[:, 0]
    ).mean() > 0.5  # Some crops show the street beside the pedestrian.


def streets() -> ImageSet:
    return image_set(
        [(np.tile(image, (3, 4, 1))[:192, :320], Truth()) for image in people(4, 8).images]
    )


EVERY = np.arange(4)
SCRATCH = {
    "size": "nano",
    "seed": 0,
    "batch_size": 1,
    "crop_iterations": 1,
    "frame_iterations": 3,
    "learning_rate": 1e-3,
    "oversampling": 2,
    "validate_every": 2,
    "patience": 5,
}


def test_training_from_scratch_resumes_in_every_phase(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[tuple[int, int]] = []

    def counted(
        images: ImageSet,
        indices: NDArray[np.int64],
        size: tuple[int, int],
        seed: tuple[int, ...],
        relit: float,
    ) -> Batch:
        sizes.append(size)
        if len(sizes) == 4:
            raise KeyboardInterrupt
        return batch(images, indices, size, seed, relit)

    uninterrupted = train_from_scratch(streets(), EVERY, streets(), SCRATCH, ALONE)
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    monkeypatch.setattr(recipe, "batch", counted)
    with pytest.raises(KeyboardInterrupt):
        train_from_scratch(streets(), EVERY, streets(), SCRATCH, Run(tmp_path / "c.pt", threads=1))
    resumed = train_from_scratch(
        streets(), EVERY, streets(), SCRATCH, Run(tmp_path / "c.pt", threads=1)
    )
    assert same(uninterrupted.model, resumed.model) and uninterrupted.curve == resumed.curve
    assert [look.iteration for look in resumed.curve] == [2, 4]
    assert sizes == [
        (160, 96),
        (320, 192),
        (320, 192),
        (320, 192),
        (320, 192),
    ]  # The fourth call was interrupted.


def test_a_training_killed_during_an_evaluation_repeats_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    images = people(4, 1)

    def fitted(checkpoint: Path | None, *scores: float | None) -> Fitted:
        answers = iter(scores)

        def ap50(_: Yolo) -> float:
            if (score := next(answers)) is None:
                raise KeyboardInterrupt
            return score

        def feed(_: int) -> Batch:
            return images.images, images.boxes

        watch = Validation(ap50, every=2, patience=2)
        return fit(
            small_network(),
            Lesson(Schedule(0, 10, 1e-3, warm_up=3), feed, validation=watch),
            Run(checkpoint, threads=1),
        )

    with pytest.raises(KeyboardInterrupt):
        fitted(tmp_path / "c", 0.5, None)
    resumed, uninterrupted = fitted(tmp_path / "c", 0.9, 0.1, 0.2), fitted(None, 0.5, 0.9, 0.1, 0.2)
    assert resumed.curve == uninterrupted.curve and same(resumed.model, uninterrupted.model)


def test_a_non_finite_loss_ends_the_training_before_its_weights_are_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)
    images, checkpoint = people(4, 2), tmp_path / "checkpoint.pt"

    def feed(iteration: int) -> Batch:
        boxes = images.boxes.copy()
        if iteration >= 7:
            boxes[0] = (np.nan, 0, 20, 20)
        return images.images, boxes

    with pytest.raises(
        InputError,
        match="the loss is not finite at iteration 8: lower learning_rate, now 0.001,"
        " or check the labels",
    ):
        fit(
            small_network(),
            Lesson(Schedule(0, 20, 1e-3, warm_up=3), feed),
            Run(checkpoint, threads=1),
        )
    kept = torch.load(io.BytesIO(read_sealed(checkpoint)), weights_only=True)
    assert kept["iteration"] == 7 and all(
        torch.isfinite(value.float()).all() for value in kept["model"].values()
    )


def test_a_training_that_no_longer_improves_ends_early_with_its_best_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    images, seen = people(4, 3), []
    monkeypatch.setattr(training, "CHECKPOINT_SECONDS", 0.0)

    def ap50(model: Yolo) -> float:
        seen.append(copy.deepcopy(model).cpu())
        return (0.3, 0.7, 0.6, 0.65, 0.9)[len(seen) - 1]

    watch = Validation(ap50, every=2, patience=2)
    schedule, checkpoint = Schedule(0, 20, 1e-3, warm_up=3), tmp_path / "checkpoint.pt"
    lesson = Lesson(schedule, lambda _: (images.images, images.boxes), validation=watch)
    fitted = fit(small_network(), lesson, Run(checkpoint, threads=1))
    assert [(look.iteration, look.ap50) for look in fitted.curve] == [
        (2, 0.3),
        (4, 0.7),
        (6, 0.6),
        (8, 0.65),
    ]
    assert same(fitted.model, seen[1])
    again = fit(small_network(), lesson, Run(checkpoint, threads=1))
    assert len(seen) == 4 and same(again.model, fitted.model)


def test_the_first_images_are_shown_as_they_are() -> None:
    assert relit_share(0) == relit_share(RELIT_FROM) == 0
    assert relit_share((RELIT_FROM + RELIT_ALL) // 2) == pytest.approx(0.5)
    assert relit_share(RELIT_ALL) == relit_share(2 * RELIT_ALL) == 1
