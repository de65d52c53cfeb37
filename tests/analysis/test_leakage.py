"""Training uses nothing of a held-out scenario."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artefacts.dataset import TRUTH_FILE, ImageSet, Record, image_set, write_truth
from pipeline.artefacts.filter_table import COLUMNS, write_filter
from pipeline.artefacts.model_card import read_card, write_card
from pipeline.artefacts.scenario_space import ScenarioInfo, write_space
from pipeline.artefacts.tables import read_frames
from pipeline.config.composing import compose
from pipeline.core.lineage import Version
from pipeline.core.truth import Truth
from pipeline.errors import InputError
from pipeline.learning.added_frames import Source, choose
from pipeline.learning.frame_filter import judge
from pipeline.learning.leakage import refuse_frames, refuse_towns
from pipeline.simulators.mujoco import random_scenes
from pipeline.simulators.mujoco.lens import CameraSettings
from tests.analysis.fabricated import FabricatedStudy
from tests.core.test_model_card import CARD
from tests.spaces import SMALL


def noise(count: int, seed: int) -> ImageSet:
    rng = np.random.default_rng(seed)
    return image_set([(rng.integers(0, 255, (32, 64, 3), dtype=np.uint8), Truth()) for _ in range(count)])


def test_frames_of_a_held_out_scenario_are_refused_by_name() -> None:
    chosen = pd.DataFrame({"test_id": ["F1-random-base-0-00000", "F1star-pairwise-base-0-00003"], "scenario": ["F1", "F1star"]})
    message = "training must not use frames of held-out scenarios: F1star-pairwise-base-0-00003; make the filter tables again"
    with pytest.raises(InputError, match=f"^{message}$"):
        refuse_frames(("F1star",), chosen, noise(2, 0), noise(2, 1))


def test_a_filter_table_with_a_test_of_another_campaign_is_refused_by_name(tmp_path: Path) -> None:
    """A test that no campaign has is refused, even if its name looks like that of a held-out scenario's test."""
    study = FabricatedStudy(tmp_path).make()
    table = tmp_path / "random.csv"
    judged = pd.DataFrame([["F1star-pairwise-base-0-00003", 0, True, "visible", 90, 20.0, 0.0]], columns=list(COLUMNS))
    write_filter(table, judged)
    with pytest.raises(InputError) as caught:
        source(study, "random", table).read()
    message = "expected frames of the campaigns' tests, got one of test 'F1star-pairwise-base-0-00003'; run filter again"
    assert str(caught.value) == f"{table}: {message}"


def test_added_frames_carry_the_scenario_of_their_campaign(tmp_path: Path) -> None:
    study = FabricatedStudy(tmp_path).make()
    sources = {}
    for kind, strategy in study.config.sources.items():
        table = tmp_path / f"{strategy}.csv"
        frames = study.paths(study.files.search("frames.parquet", strategy=strategy))
        write_filter(table, pd.concat([judge(read_frames(path), study.config.filter) for path in frames]))
        sources[kind] = source(study, strategy, table)
    chosen = choose(study.config, sources, Version("random", 1), study.paths(study.files.spaces(study.config.search)), seed=0)
    assert len(chosen) and (chosen["scenario"] == chosen["test_id"].str.split("-").str[0]).all()
    refuse_frames(study.config.held_out, chosen, noise(len(chosen), 0), noise(1, 1))


def source(study: FabricatedStudy, strategy: str, table: Path) -> Source:
    return Source([table], study.paths(study.files.search("tests.parquet", strategy=strategy)))


def test_validation_frames_are_refused_by_name() -> None:
    tests = pd.DataFrame({"test_id": ["F1-random-base-0-00000", "F1-random-base-0-00003"], "scenario": "F1"})
    refuse_frames(("F1star",), tests, noise(2, 0), noise(2, 1))
    validation = noise(3, 1)
    added = image_set([(noise(1, 0).images[0], Truth()), (validation.images[2], Truth())])
    with pytest.raises(InputError, match="a frame of F1-random-base-0-00003 is a validation image"):
        refuse_frames(("F1star",), tests, added, validation)


def test_held_out_towns_are_refused_by_name_under_any_config(tmp_path: Path) -> None:
    config = compose("default", [])
    own, unseen = (config.scenarios[name].town.fingerprint for name in ("F1", "F1star"))

    def files(base_town: str, driven: str) -> tuple[Path, list[Path]]:
        write_truth(tmp_path, [Record("train", 0, 64, 32, Truth(), {"town": base_town})])
        write_space(tmp_path / "F1.json", ScenarioInfo("F1", "F1", "", 1, driven), SMALL)
        return tmp_path / TRUTH_FILE, [tmp_path / "F1.json"]

    refuse_towns(config, *files("a random one", own))
    with pytest.raises(InputError, match=r"truth\.coco\.json shows the town of held-out F1star, so it must not be used for training"):
        refuse_towns(config, *files(unseen, own))
    with pytest.raises(InputError, match=r"F1\.json describes the town of held-out F1star, so it must not be used for training"):
        refuse_towns(config, *files("a random one", unseen))
    base = tmp_path / "model.json"
    write_card(base, CARD.model_copy(update={"towns": ("a learnt one",)}))
    assert refuse_towns(config, *files("a random one", own), base) == tuple(sorted(["a random one", own, "a learnt one"]))
    write_card(base, CARD.model_copy(update={"towns": ("a learnt one", unseen)}))
    with pytest.raises(InputError, match=r"model\.json has learnt the town of held-out F1star, so it must not be used for training"):
        refuse_towns(config, *files("a random one", own), base)
    write_truth(tmp_path, [Record("train", 0, 64, 32, Truth(), {})])
    with pytest.raises(InputError, match=r"truth\.coco\.json does not list the towns that its images show"):
        refuse_towns(config, tmp_path / TRUTH_FILE, [])


def test_the_shipped_detector_lists_its_training_towns() -> None:
    config = compose("base", [])
    towns = read_card(Path(config.base.weights) / "model.json").towns
    drawn = {random_scenes._town(np.random.default_rng([config.base_set.seed, shard])).fingerprint for shard in range(400)}
    assert set(towns) == drawn and len(drawn) == 400


def test_a_random_town_of_a_held_out_scenario_is_refused_by_name() -> None:
    town = random_scenes._town(np.random.default_rng([5, 3]))
    with pytest.raises(InputError, match=r"base_set\.seed 5: random town 3 is the town of held-out F1star"):
        next(random_scenes.scenes(3, 1, 5, CameraSettings(), {"F2star": compose("default", []).scenarios["F1star"].town, "F1star": town}))
