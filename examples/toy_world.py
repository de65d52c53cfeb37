"""Your own simulator in a page: a grey road and a bright figure. The comments mark your calls."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from pipeline.core.braking import Vehicle
from pipeline.core.encounter import Encounter, RoadUsers
from pipeline.core.ground import Pinhole
from pipeline.core.space import Value
from pipeline.core.truth import Truth
from pipeline.protocols import Observation
from pipeline.scenarios.functional import FunctionalScenario


class ToyWorld:
    needs: ClassVar = {"fog": (0.0, 100.0), "pedestrian_speed": (0.0, 10.0)}
    frame_s, step_s = 0.1, 0.05  # 10 images a second; a contact is looked for every 50 ms
    camera = Pinhole(width=128, height=96, focal_px=110, ahead_m=0.5, above_m=1.4)

    def __init__(self, scenario: FunctionalScenario, vehicle: Vehicle) -> None:
        self.scenario, self.encounter = scenario, scenario.encounter()  # load your map

    def reset(self, concrete: Mapping[str, Value], seed: int) -> Encounter:
        self.walking, self.fog = float(concrete["pedestrian_speed"]), float(concrete["fog"])
        self.time, self.rng = 0.0, np.random.default_rng(seed)  # set weather, seed your noise
        self.s, self.speed = self.scenario.start_s(), self.scenario.ego.speed_kmh / 3.6
        return self.encounter

    def observe(self) -> Observation:
        users, cam = self.users(), self.camera  # read your camera and its segmentation
        ahead, left = users.ego.seen(self.scenario.pedestrian_pose(self.time, self.walking))
        metres = max(1.0, ahead - cam.ahead_m)
        sides = cam.width / 2 + cam.focal_px * (np.array([-0.3, 0.3]) - left) / metres
        ends = cam.height / 2 + cam.focal_px * (cam.above_m - np.array([1.7, 0.0])) / metres
        (x0, x1), (y0, y1) = (sides.clip(0, cam.width).round(), ends.clip(0, cam.height).round())
        image = self.rng.integers(70, 90, (cam.height, cam.width, 3), dtype=np.uint8)
        if x0 == x1 or y0 == y1:
            return Observation(image, Truth(), users)
        contrast = 150 * (1 - self.fog / 100) ** (metres / 10)
        image[int(y0) : int(y1), int(x0) : int(x1)] += np.uint8(contrast)
        box, pixels = (float(x0), float(y0), float(x1), float(y1)), int((x1 - x0) * (y1 - y0))
        return Observation(image, Truth(box, box, pixels, pixels, contrast), users)

    def advance(self, seconds: float, acceleration_mps2: float) -> RoadUsers:
        self.s += self.speed * seconds  # apply the demand and tick your simulator
        self.speed = max(0.0, self.speed + acceleration_mps2 * seconds)
        self.time = round(self.time + seconds, 9)
        return self.users()

    def users(self) -> RoadUsers:  # read your actors
        pedestrian = self.scenario.pedestrian_pose(self.time, self.walking)
        return RoadUsers(self.time, self.s, self.encounter.path.at(self.s), self.speed, pedestrian)
