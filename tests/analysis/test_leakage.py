"""Training uses nothing of a held-out scenario."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artefacts.dataset import (
    TRUTH_FILE,
    ImageSet,
    Record,
    image_set,
    read_worlds,
    write_image,
    write_truth,
)
from pipeline.artefacts.filter_table import COLUMNS, write_filter
from pipeline.artefacts.model_card import read_card, write_card
from pipeline.artefacts.scenario_space import ScenarioInfo, write_space
from pipeline.artefacts.tables import read_frames, write_frames
from pipeline.config.composing import compose
from pipeline.core.lineage import Version
from pipeline.core.truth import Truth
from pipeline.errors import InputError
from pipeline.execution.image_sets import SHARD_IMAGES
from pipeline.learning.added_frames import Campaigns, Scenes, Source, choose
from pipeline.learning.frame_filter import judge
from pipeline.learning.leakage import refuse_frames, refuse_learnt, refuse_worlds
from pipeline.scenarios.people import fingerprint
from pipeline.simulators.mujoco import random_scenes
from pipeline.simulators.mujoco.lens import CameraSettings
from tests.analysis.fabricated import FabricatedStudy
from tests.cards import CARD
from tests.spaces import SMALL
from tests.studies import ROOT, StudyFolder


def noise(count: int, seed: int) -> ImageSet:
    rng = np.random.default_rng(seed)
    return image_set(
        [(rng.integers(0, 255, (32, 64, 3), dtype=np.uint8), Truth()) for _ in range(count)]
    )


def test_frames_of_a_held_out_scenario_are_refused_by_name() -> None:
    chosen = pd.DataFrame(
        {
            "test_id": ["F1-random-base-0-00000", "F1star-pairwise-base-0-00003"],
            "scenario": ["F1", "F1star"],
        }
    )
    message = (
        "training must not use frames of held-out scenarios: F1star-pairwise-base-0-00003; make "
        "the filter tables again"
    )
    with pytest.raises(InputError, match=f"^{message}$"):
        refuse_frames(("F1star",), chosen, noise(2, 0), noise(2, 1))


def test_frames_of_other_campaigns_are_never_drawn(tmp_path: Path) -> None:
    """A filter table may contain frames of other seeds, or a row about a held-out test."""
    study = FabricatedStudy(tmp_path).make()
    table = tmp_path / "random.csv"
    judged = pd.DataFrame(
        [["F1star-pairwise-base-0-00003", 0, True, "visible", 90, 20.0, 0.0]], columns=list(COLUMNS)
    )
    write_filter(table, judged)
    assert campaigns(study, "random", table).pool().empty


def test_added_frames_carry_the_scenario_of_their_campaign(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    sources: dict[str, Source] = {}
    for arm, strategy in study.config.sources.items():
        table = tmp_path / f"{strategy}.csv"
        frames = study.paths(study.files.search("frames.parquet", strategy=strategy))
        write_filter(
            table, pd.concat([judge(read_frames(path), study.config.filter) for path in frames])
        )
        sources[arm] = campaigns(study, strategy, table)
    chosen = choose(study.config, sources, Version("random", 1), seed=0)
    assert len(chosen) and (chosen["scenario"] == chosen["test_id"].str.split("-").str[0]).all()
    refuse_frames(study.config.held_out, chosen, noise(len(chosen), 0), noise(1, 1))
    assert len(sources["random"].read(chosen)) == len(chosen)


def test_an_arm_without_empty_frames_is_named_with_its_counts(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    rows = [[f"F1-random-base-0-{n:05}", 0, True, "visible", 90, 20.0, 0.0] for n in range(2)]
    write_filter(tmp_path / "random.csv", pd.DataFrame(rows, columns=list(COLUMNS)))
    sources: dict[str, Source] = {"random": campaigns(study, "random", tmp_path / "random.csv")}
    with pytest.raises(
        InputError,
        match=r"^arms: too few frames to train random on \(2 with a pedestrian, 0 without\), and "
        r"`retrain",
    ):
        choose(study.config, sources, Version("random", 1), seed=0)


def campaigns(study: FabricatedStudy, strategy: str, table: Path) -> Campaigns:
    tests, frames = (
        study.paths(study.files.search(f"{name}.parquet", strategy=strategy))
        for name in ("tests", "frames")
    )
    return Campaigns(
        study.config, [table], tests, study.paths(study.files.spaces(study.config.search)), frames
    )


def test_validation_frames_are_refused_by_name() -> None:
    tests = pd.DataFrame(
        {"test_id": ["F1-random-base-0-00000", "F1-random-base-0-00003"], "scenario": "F1"}
    )
    refuse_frames(("F1star",), tests, noise(2, 0), noise(2, 1))
    validation = noise(3, 1)
    added = image_set([(noise(1, 0).images[0], Truth()), (validation.images[2], Truth())])
    with pytest.raises(InputError, match="a frame of F1-random-base-0-00003 is a validation image"):
        refuse_frames(("F1star",), tests, added, validation)


@pytest.mark.parametrize("kind", ["town", "people"])
def test_held_out_worlds_are_refused_by_name_under_any_config(tmp_path: Path, kind: str) -> None:
    config = compose("default", [])
    allowed, unseen = (dict(config.scenarios[name].worlds)[kind] for name in ("F1", "F1star"))

    def files(shown: str, driven: str) -> tuple[list[Path], list[Path]]:
        worlds = {"town": "another town", "people": "other people"}
        write_truth(tmp_path, [Record("train", 0, 64, 32, Truth(), worlds | {kind: shown})])
        world = worlds | {kind: driven}
        write_space(
            tmp_path / "F1.json",
            ScenarioInfo("F1", "F1", "", 1, world["town"], world["people"]),
            SMALL,
        )
        return [tmp_path / TRUTH_FILE], [tmp_path / "F1.json"]

    def learnt(*ones: str) -> Path:
        field = {"town": "towns", "people": "people"}[kind]
        write_card(tmp_path / "model.json", CARD.model_copy(update={field: ones}))
        return tmp_path / "model.json"

    refuse_worlds(config, *files("a random one", allowed))
    with pytest.raises(
        InputError,
        match=rf"truth\.coco\.json shows the {kind} of held-out F1star, so it must not be used "
        r"for training",
    ):
        refuse_worlds(config, *files(unseen, allowed))
    with pytest.raises(
        InputError,
        match=rf"F1\.json describes the {kind} of held-out F1star, so it must not be used for "
        r"training",
    ):
        refuse_worlds(config, *files("a random one", unseen))
    worlds = refuse_worlds(config, *files("a random one", allowed), learnt("a learnt one"))
    assert [world for what, world in worlds if what == kind] == sorted(
        {"a random one", allowed, "a learnt one"}
    )
    with pytest.raises(
        InputError,
        match=rf"model\.json was trained on the {kind} of held-out F1star, so it must not be used "
        r"for training",
    ):
        refuse_worlds(config, *files("a random one", allowed), learnt("a learnt one", unseen))


@pytest.mark.parametrize("attributes", [{}, {"town": "a town"}, {"people": "some"}])
def test_images_must_list_their_towns_and_people(
    tmp_path: Path, attributes: dict[str, str]
) -> None:
    write_truth(tmp_path, [Record("train", 0, 64, 32, Truth(), attributes)])
    with pytest.raises(
        InputError,
        match=r"truth\.coco\.json does not list the towns and people that its images show",
    ):
        refuse_worlds(compose("default", []), [tmp_path / TRUTH_FILE], [])


@pytest.mark.parametrize(
    ("kind", "update"), [("town", {"towns": ("T",)}), ("people", {"people": ("P",)})]
)
def test_a_version_that_has_learnt_a_held_out_world_is_not_compared(
    kind: str, update: dict[str, tuple[str, ...]]
) -> None:
    held_out = [
        ScenarioInfo("F2star", "F2*", "", 1, "U", "Q"),
        ScenarioInfo("F1star", "F1*", "", 1, "T", "P"),
    ]
    refuse_learnt([CARD], held_out)
    message = (
        f"version 'random' was trained on the {kind} of held-out F1star, so its failures there "
        "prove nothing"
    )
    with pytest.raises(InputError, match=message):
        refuse_learnt([CARD, CARD.model_copy(update=update)], held_out)


def test_scenarios_without_people_share_none() -> None:
    refuse_learnt([CARD.model_copy(update={"people": ()})], [ScenarioInfo("G1", "G1", "", 1, "T")])
    assert not CARD.worlds & ScenarioInfo("G1", "G1", "", 1).worlds


@pytest.mark.parametrize(("study", "model"), [("base", "uniform"), ("long_tailed", "long_tailed")])
def test_a_shipped_base_lists_the_worlds_that_its_study_shows(study: str, model: str) -> None:
    config = compose(study, [])
    card, shards = (
        read_card(ROOT / "models" / model / "model.json"),
        config.base_set.images // SHARD_IMAGES,
    )
    drawn = [
        random_scenes._world(np.random.default_rng([config.base_set.seed, shard]))
        for shard in range(shards)
    ]
    assert (
        card.worlds.towns == {town.fingerprint for town, _ in drawn} and len(card.towns) == shards
    )
    assert card.worlds.people == {fingerprint(people) for _, people in drawn}


@pytest.mark.parametrize("kind", ["town", "people"])
def test_a_random_world_of_a_held_out_scenario_is_refused_by_name(kind: str) -> None:
    base_set = compose("default", ["base_set.seed=5"]).base_set
    town, people = random_scenes._world(np.random.default_rng([5, 3]))
    drawn = {"town": town.fingerprint, "people": fingerprint(people)}[kind]
    with pytest.raises(
        InputError,
        match=rf"base_set\.seed 5 draws the {kind} of held-out F1star for shard 3; choose another "
        r"seed",
    ):
        next(
            random_scenes.scenes(
                3, 1, base_set, CameraSettings(), {"another": "F2star", drawn: "F1star"}
            )
        )


def test_the_base_set_lists_the_worlds_of_its_images(tmp_path: Path) -> None:
    study = StudyFolder.composed(tmp_path, "smoke", ["base_set.images=110"])
    assert study.run("render-base") == 0
    worlds = [random_scenes._world(np.random.default_rng([1, shard])) for shard in range(2)]
    shown = read_worlds(study / "base_set")
    assert shown.towns == {town.fingerprint for town, _ in worlds}
    assert shown.people == {fingerprint(people) for _, people in worlds}


@dataclass(frozen=True)
class Pool:
    """A source with so many frames with a pedestrian, and as many without."""

    frames: int

    def pool(self) -> pd.DataFrame:
        rows = {
            "test_id": "t",
            "step": range(2 * self.frames),
            "empty": np.arange(2 * self.frames) % 2 == 0,
        }
        return pd.DataFrame({**rows, "group": "", "scenario": "F1", "weight": 1.0})

    def read(self, chosen: pd.DataFrame) -> ImageSet:
        return noise(len(chosen), 0)


@pytest.mark.parametrize(
    ("added", "round", "frames"), [(4, 1, 4), (4, 2, 8), (100, 1, 20), (100, 2, 20)]
)
def test_all_arms_get_as_many_frames_as_the_poorest_can_give_and_more_each_round(
    added: int, round: int, frames: int
) -> None:
    config = compose("default", [f"retraining.added_frames={added}", "retraining.empty_share=0.5"])
    sources: dict[str, Source] = {"random": Pool(10), "adaptive": Pool(50)}
    assert {len(choose(config, sources, Version(arm, round), seed=0)) for arm in sources} == {
        frames
    }


def test_the_digest_of_added_frames_knows_their_pixels(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    path = study.paths(study.files.search("frames.parquet", strategy="random"))[0]
    source, frames = campaigns(study, "random", tmp_path / "none.csv"), read_frames(path)
    chosen = frames[["test_id", "step"]].head(3)
    before = source.read(chosen).digest
    write_frames(path, frames.assign(image=[frames["image"].iloc[1], *frames["image"].iloc[1:]]))
    assert source.read(chosen).digest != before


def test_new_scenes_are_drawn_if_their_pedestrian_is_as_visible_as_the_filter_demands(
    tmp_path: Path,
) -> None:
    config = compose("default", [])
    pixels = config.filter.min_visible_pixels
    contrast = config.filter.min_detectability / pixels**0.5
    box, worlds = (8.0, 4.0, 16.0, 20.0), {"town": "a", "people": "b"}
    shown = [
        Truth(),
        Truth(box, box, pixels, 90, contrast + 1e-6),
        Truth(box, box, pixels - 1, 90, 90),
        Truth(box, box, pixels, 90, contrast - 1),
    ]
    for index, truth in enumerate(shown):
        write_image(tmp_path, "train", index, noise(1, index).images[0], truth)
    write_truth(
        tmp_path,
        [Record("train", index, 64, 32, truth, worlds) for index, truth in enumerate(shown)],
    )
    assert Scenes(config, tmp_path / TRUTH_FILE).pool()["step"].tolist() == [0, 1]


def test_the_scenes_that_are_drawn_are_those_that_are_read(tmp_path: Path) -> None:
    shades = (0, 50, 100, 150)
    for index, shade in enumerate(shades):
        write_image(tmp_path, "train", index, np.full((32, 64, 3), shade, np.uint8), Truth())
    worlds = {"town": "a", "people": "b"}
    write_truth(
        tmp_path, [Record("train", index, 64, 32, Truth(), worlds) for index in range(len(shades))]
    )
    source = Scenes(compose("default", []), tmp_path / TRUTH_FILE)
    chosen = source.pool().iloc[[3, 1]]
    read = source.read(chosen)
    assert read.images.mean((1, 2, 3)) == pytest.approx([150, 50], abs=1)
    assert read.digest != source.read(chosen.iloc[::-1]).digest
