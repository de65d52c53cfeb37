"""A job that is killed after its work, but before its end, resumes with the same bytes.

Its scratch folder stays whole until its stamp is written.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.artefacts import stamps
from pipeline.config.composing import compose
from pipeline.config.schema import Config
from pipeline.contract import Order, order_of, perform
from pipeline.core.truth import Truth
from pipeline.execution import image_sets
from pipeline.execution.workers import Execution, Workers
from pipeline.simulators.mujoco import random_scenes
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.simulators.mujoco.random_scenes import Scene
from tests.campaigns import analytic_study, folder, journal, key, same
from tests.studies import ROOT, StudyFolder

SCRATCH, IMAGE = Path("data/smoke/journal/render_base"), "images/train/000000.jpg"


class Killed(BaseException):
    """In place of kill -9."""


def kill(*_: Any, **named: Any) -> None:
    raise Killed


@pytest.fixture
def config() -> Config:
    with chdir(ROOT):
        return compose("smoke", ["base_set.images=10"])


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The shards that are rendered: four images each, of noise, in this process."""
    shards: list[int] = []

    def scenes(
        shard: int, count: int, _section: Any, camera: CameraSettings, _unseen: Any
    ) -> Iterator[Scene]:
        shards.append(shard)
        rng = np.random.default_rng(shard)
        for _ in range(count):
            image = rng.integers(0, 255, (camera.height, camera.width, 3), dtype=np.uint8)
            yield Scene(
                image,
                Truth((1.0, 2.0, 9.0, 30.0), (1.0, 2.0, 9.0, 30.0), 90, 90, 20.0),
                {"town": f"t{shard}", "people": "p"},
            )

    def in_order(
        function: Callable[[Any], Any], jobs: Sequence[Any], _processes: int
    ) -> Iterator[Any]:
        return map(function, jobs)

    monkeypatch.setattr(random_scenes, "scenes", scenes)
    monkeypatch.setattr(image_sets, "in_order", in_order)
    monkeypatch.setattr(image_sets, "SHARD_IMAGES", 4)
    return shards


def rendering(config: Config) -> Order:
    return order_of("render_base", config, {}, "today")


def remove_outputs(order: Order) -> None:
    """As Snakemake does for a job that did not end."""
    for path in order.writes.values():
        assert isinstance(path, str)
        stamps.remove(Path(path))


def files() -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in Path("data").rglob("*") if path.is_file()}


def in_placing(patch: pytest.MonkeyPatch) -> None:
    link, calls = Path.hardlink_to, iter(range(7))
    patch.setattr(
        Path,
        "hardlink_to",
        lambda self, other: kill() if next(calls, None) is None else link(self, other),
    )


def in_removing(part: str, patch: pytest.MonkeyPatch) -> None:
    remove = shutil.rmtree

    def kill_midway(path: Path, ignore_errors: bool = False) -> None:
        if path == SCRATCH:
            remove(path / part)
            kill()
        remove(path, ignore_errors)

    patch.setattr(shutil, "rmtree", kill_midway)


MOMENTS: dict[str, tuple[Callable[[pytest.MonkeyPatch], None], list[int]]] = {
    "its images are put in place": (in_placing, []),
    "its files are hashed": (lambda patch: patch.setattr(stamps, "made", kill), []),
    "the images in its scratch are removed": (partial(in_removing, "images"), [0, 1, 2]),
    "the records in its scratch are removed": (partial(in_removing, "shards"), [0, 1, 2]),
}
"""When a job is killed, and the shards to render again."""


@pytest.mark.parametrize(("killing", "again"), MOMENTS.values(), ids=MOMENTS.keys())
def test_a_data_set_killed_while(
    killing: Callable[[pytest.MonkeyPatch], None],
    again: list[int],
    config: Config,
    rendered: list[int],
    tmp_path: Path,
) -> None:
    order = rendering(config)
    for name in ("whole", "cut"):
        (tmp_path / name).mkdir()
    with chdir(tmp_path / "whole"):
        perform(order, config)
        whole = files()
        assert (
            IMAGE in {name.removeprefix("data/smoke/base_set/") for name in whole}
            and not SCRATCH.exists()
        )
    with chdir(tmp_path / "cut"):
        with pytest.MonkeyPatch.context() as patch:
            killing(patch)
            with pytest.raises(Killed):
                perform(order, config)
        remove_outputs(order)
        rendered.clear()
        perform(order, config)
        assert rendered == again and files() == whole and not SCRATCH.exists()


def test_only_shards_with_their_own_images_are_resumed(
    config: Config, rendered: list[int], tmp_path: Path
) -> None:
    order = rendering(config)
    with chdir(tmp_path):
        perform(order, config)
        whole = files()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(stamps, "made", kill)
            with pytest.raises(Killed):
                perform(order, config)
        # Another study's settings begin to overwrite the images of the first shard;
        # then the old settings are back.
        (SCRATCH / IMAGE).unlink()
        (SCRATCH / IMAGE).write_bytes(b"of other settings")
        rendered.clear()
        perform(order, config)
        assert rendered == [0] and files() == whole


def test_shards_of_other_held_out_scenarios_are_rendered_again(
    config: Config, rendered: list[int], tmp_path: Path
) -> None:
    """Rendering rejects held-out towns and people.

    A shard that was rendered for other held-out scenarios is not checked yet.
    """
    with chdir(ROOT):
        other = compose("smoke", ["base_set.images=10", "held_out=[F2star]"])
    with chdir(tmp_path):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(stamps, "made", kill)
            with pytest.raises(Killed):
                perform(rendering(config), config)
        remove_outputs(rendering(config))
        rendered.clear()
        perform(rendering(other), other)
        assert rendered == [0, 1, 2]


def test_a_disk_without_second_names_gets_copies(
    config: Config, rendered: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: Path, other: Path) -> None:
        raise PermissionError

    order, made = rendering(config), []
    for name in ("linked", "copied"):
        (tmp_path / name).mkdir()
        with chdir(tmp_path / name):
            perform(order, config)
            made.append(files())
        monkeypatch.setattr(Path, "hardlink_to", refuse)
    assert made[0] == made[1]


def test_a_campaign_killed_while_its_tables_are_hashed_executes_no_test_again(
    one_worker: StudyFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = analytic_study(tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stamps, "made", kill)
        with pytest.raises(Killed):
            study.run("campaign", **key())
    shutil.rmtree(folder(study))

    def none(self: Workers, jobs: Sequence[Execution]) -> Iterator[int]:
        assert not jobs
        return iter(())

    monkeypatch.setattr(Workers, "execute", none)
    assert study.run("campaign", **key()) == 0
    assert same(folder(one_worker), folder(study)) and not journal(study).exists()


def test_the_shards_of_other_settings_or_code_are_rendered_again(
    config: Config, rendered: list[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shards(drawing: image_sets.Drawing) -> list[int]:
        rendered.clear()
        image_sets.render_images(
            drawing, tmp_path / "scratch", tmp_path / "out", 1, lambda *_: None
        )
        return list(rendered)

    drawing, every = image_sets.Drawing(config.base_set, config.camera, {}), [0, 1, 2]
    assert (shards(drawing), shards(drawing)) == (every, [])
    changes: list[dict[str, Any]] = [
        {"camera": {**config.camera, "hfov_deg": 70.0}},
        {"section": config.base_set.model_copy(update={"seed": 9})},
        {"unseen": {"a town": "F1star"}},
    ]
    for change in changes:
        drawing = replace(drawing, **change)
        assert shards(drawing) == every
    monkeypatch.setattr(image_sets, "program_sha256", lambda: "other code")
    assert shards(drawing) == every
