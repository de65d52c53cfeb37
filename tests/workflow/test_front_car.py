"""A small front-car study from start to end: points, snapshots, two detectors, a page."""

from __future__ import annotations

import hashlib
from collections import Counter
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.artefacts.dataset import image_path, read_dataset, segments_path
from pipeline.artefacts.front_car_results import DetectorResult, Evaluation, Judged, Points
from pipeline.artefacts.model_card import read_card
from pipeline.artefacts.results import read
from pipeline.config.composing import compose
from pipeline.config.schema import Config
from pipeline.core.coverage.projection import Demand
from pipeline.core.coverage.proposals import Proposer
from pipeline.core.truth import Truth
from pipeline.report.front_car_page import by_condition, first_covering
from pipeline.steps.front_car_evaluate import is_right
from tests.data_sets import AWAY, PERSON, detected
from tests.studies import StudyFolder

SMALL = [
    "front_car.images=33",
    "front_car.test_images=1",
    "front_car.iterations=2",
    "front_car.batch_size=4",
    "front_car.validation_share=0.4",
]


@pytest.fixture(scope="module")
def config() -> Config:
    return compose("front_car", ["base.weights=models/uniform", *SMALL])


def test_too_few_images_for_a_validation_image_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = StudyFolder.composed(
        tmp_path, "front_car", [*SMALL, "front_car.images=20", "front_car.validation_share=0.15"]
    )
    assert study.run("front-car-points") == 0
    assert study.run("front-car-snapshots", version="covered") == 2
    assert "front_car.images: expected an image of each of " in capsys.readouterr().err


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory, config: Config) -> Path:
    folder = StudyFolder.of(tmp_path_factory.mktemp("front_car"), config)
    assert folder.run("front-car-points") == 0
    for version in ("existing", "covered", "test"):
        assert folder.run("front-car-snapshots", threads=2, version=version) == 0
    for version in ("existing", "covered"):
        assert folder.run("front-car-train", threads=2, version=version) == 0
    assert folder.run("front-car-evaluate") == folder.run("front-car-report") == 0
    return folder / ""


def test_five_random_points_and_proposals_cover_every_pair(study: Path, config: Config) -> None:
    points = read(study / "points.json", Points)
    space = config.front_car.space.space()
    categories = space.categorise(
        np.array([space.encode(dict(point.values)) for point in points.points])
    )
    assert [point.name for point in points.points[:6]] == [
        "E1",
        "E2",
        "E3",
        "E4",
        "E5",
        "G1",
    ] and len(points.points) <= 11
    assert points.points[-1].covered == points.required == 69
    assert space.constraints.holds(categories).all()
    names = [point.name for point in points.points]
    for chosen in combinations(range(len(space)), 2):
        cells = np.array(first_covering(categories, names, space.sizes, chosen))
        assert ((cells != "") == space.constraints.feasible_cells(chosen)).all()


def test_points_share_the_images_as_evenly_as_possible(config: Config) -> None:
    assert config.front_car.model_copy(update={"images": 20}).images_of(7) == [3, 3, 3, 3, 3, 3, 2]


def names_in(folder: Path) -> set[Path]:
    """The relative paths of a folder's pictures, without suffix."""
    return {path.relative_to(folder).with_suffix("") for path in folder.rglob("*.*g")}


def test_each_set_has_its_snapshots(study: Path, config: Config) -> None:
    for version, train, val in (("existing", 20, 13), ("covered", 33, None), ("test", 0, 72)):
        folder = study / "snapshots" / version
        images, segments = names_in(folder / "images"), names_in(folder / "segments")
        assert images == segments
        if val is None:
            assert len(images) == train
        else:
            counts = Counter(path.parts[0] for path in images)
            assert (counts["train"], counts["val"]) == (train, val)
    tested = read_dataset(study / "snapshots" / "test", "val")
    present = [point[4] for point in config.front_car.space.feasible_points()]
    assert [bool(box[2] > box[0]) for box in tested.boxes] == [bool(value) for value in present]


def digests_in(folder: Path) -> set[str]:
    """The digests of a folder's JPEG files."""
    return {hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.rglob("*.jpg")}


def test_existing_and_covered_share_the_snapshots_of_the_random_points(study: Path) -> None:
    existing, covered, test = (
        digests_in(study / "snapshots" / version / "images")
        for version in ("existing", "covered", "test")
    )
    assert existing & covered and existing != covered
    assert not test & (existing | covered)


def test_a_segmentation_opens_as_a_picture(study: Path) -> None:
    path = segments_path(study / "snapshots" / "covered", "train", 0)
    picture = Image.open(path)
    assert picture.mode == "P" and len(np.unique(np.asarray(picture))) > 5
    assert (
        np.asarray(picture.convert("RGB")).shape
        == np.asarray(Image.open(image_path(path.parents[2], "train", 0))).shape
    )


def test_both_detectors_have_equal_training_and_the_same_tests(study: Path) -> None:
    cards = [
        read_card(study / "detectors" / version / "model.json")
        for version in ("existing", "covered")
    ]
    assert (
        cards[0].data["parent"] == cards[1].data["parent"]
        and cards[0].data["snapshots"] != cards[1].data["snapshots"]
    )
    evaluation = read(study / "evaluation.json", Evaluation)
    assert [detector.learnt_points for detector in evaluation.detectors] == [
        5,
        len(read(study / "points.json", Points).points),
    ]
    assert all(len(detector.points) == 72 for detector in evaluation.detectors)


def test_the_page_shows_the_table_the_growth_and_the_images(study: Path) -> None:
    page = (study / "front_car.html").read_text().replace("\u00a0", " ")
    for text in (
        "100 % 2-projection coverage",
        "69 of 69",
        "weather × lanes",
        "E5",
        "By operating condition",
    ):
        assert text in page
    for name in ("table", "growth", "gallery", "by_condition"):
        assert np.asarray(Image.open(study / "plots" / f"{name}.png")).std() > 5


def test_a_detector_is_right_if_it_finds_the_vehicle_that_is_there_and_nothing_else() -> None:
    answers = [
        detected((PERSON, 0.9)),
        detected((PERSON, 0.9), (AWAY, 0.8)),
        detected(),
        detected((PERSON, 0.4)),
        detected((AWAY, 0.9)),
    ]
    for truth, right in (
        (Truth(PERSON, PERSON, 800, 800, 50.0), [True, False, False, False, False]),
        (
            Truth(PERSON, PERSON, 20, 20, 50.0),
            [True, False, True, True, False],
        ),  # Too small for a person to see.
        (Truth(), [False, False, True, True, False]),
    ):
        assert [is_right(answer, truth, 0.5) for answer in answers] == right


def test_a_value_that_no_point_has_is_no_row(config: Config) -> None:
    space = config.front_car.space.space()
    values = {variable.name: str(variable.labels[0]) for variable in space.variables}
    tested = DetectorResult(
        version="a",
        learnt_points=1,
        images=2,
        metrics={},
        points=(Judged(values=values, right=(True, False)),),
    )
    (axis,) = by_condition(Evaluation(threshold=0.5, detectors=(tested, tested)), space).axes
    assert [label.get_text() for label in axis.get_yticklabels()] == [
        f"{k.replace('_', ' ')}: {v}" for k, v in values.items()
    ]


def test_the_same_seed_renders_the_same_snapshots(
    study: Path, config: Config, tmp_path: Path
) -> None:
    again = StudyFolder.of(tmp_path, config)
    assert (
        again.run("front-car-points") == again.run("front-car-snapshots", version="existing") == 0
    )
    roots = [folder / "snapshots" / "existing" for folder in (study, again / "")]
    for files in (
        [root / "truth.coco.json" for root in roots],
        [image_path(root, "train", 2) for root in roots],
    ):
        assert files[0].read_bytes() == files[1].read_bytes()


def test_too_many_random_points_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = StudyFolder.composed(tmp_path, "front_car", ["front_car.existing=73"])
    assert folder.run("front-car-points") == 2
    assert (
        "front_car.existing must be at most 72, the number of feasible points; got 73"
        in capsys.readouterr().err
    )


def test_five_points_complete_the_paper_s_example_and_seven_cover_it_from_scratch() -> None:
    """Section 5.

    E1 to E5 as in Table 1: all rainy and in the first lane; the paper says no more about E5, so it
    is assumed to equal E3.
    """
    domain = compose("front_car", []).front_car.space
    present = np.array(
        [
            [2, 0, 1, 0, 1, 0],
            [2, 1, 1, 0, 1, 0],
            [2, 1, 0, 0, 0, 1],
            [2, 1, 1, 0, 1, 1],
            [2, 1, 0, 0, 0, 1],
        ]
    )
    proposer = Proposer(Demand(domain.space().constraints, 2))
    for points, needed in ((present, 5), (present[:0], 7)):
        missing = int(proposer.missing(points).sum())
        fewer, enough = proposer.propose(points, needed - 1), proposer.propose(points, needed)
        assert fewer is not None and enough is not None
        assert fewer.gain < enough.gain == missing
    exact = proposer.propose_exact(present)
    assert exact is not None and exact.optimal
