"""Nothing of a held-out scenario can be learnt."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.artefacts.dataset import ImageSet, image_set
from pipeline.config import compose
from pipeline.protocols import InputError, Truth
from pipeline.simulators.mujoco import random_scenes
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.steps.retrain import refuse_leaks


def noise(count: int, seed: int) -> ImageSet:
    rng = np.random.default_rng(seed)
    return image_set([(rng.integers(0, 255, (32, 64, 3), dtype=np.uint8), Truth()) for _ in range(count)])


def test_frames_of_a_held_out_scenario_are_refused_by_name() -> None:
    config, tests = compose("default", []), ["F1-random-base-0-00000", "F1star-pairwise-base-0-00003"]
    with pytest.raises(InputError, match="frames of held-out scenarios must not be learnt: F1star-pairwise-base-0-00003"):
        refuse_leaks(config, tests, noise(2, 0), noise(2, 1))


def test_frames_that_validate_are_refused_by_name() -> None:
    config, tests = compose("default", []), ["F1-random-base-0-00000", "F1-random-base-0-00003"]
    refuse_leaks(config, tests, noise(2, 0), noise(2, 1))
    validation = noise(3, 1)
    added = image_set([(noise(1, 0).images[0], Truth()), (validation.images[2], Truth())])
    with pytest.raises(InputError, match="a frame of F1-random-base-0-00003 is an image that validates"):
        refuse_leaks(config, tests, added, validation)


def test_a_random_town_of_a_held_out_scenario_is_refused_by_name() -> None:
    town = random_scenes._town(np.random.default_rng([5, 3]))
    with pytest.raises(InputError, match=r"base_set\.seed 5: random town 3 is that of held-out F1star"):
        next(random_scenes.scenes(3, 1, 5, CameraSettings(), {"F2star": compose("default", []).scenarios["F1star"].town, "F1star": town}))
