"""Snapshots of the front-car domain show their point's conditions, and their labels fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.config.composing import compose
from pipeline.errors import InputError
from pipeline.scenarios.streets import Town, streets
from pipeline.simulators.mujoco.lens import CameraSettings
from pipeline.simulators.mujoco.snapshots import CLASSES, Snapshot, snapshots
from pipeline.simulators.mujoco.stage import Stage
from pipeline.simulators.mujoco.weather import Weather
from pipeline.steps.front_car_snapshots import render_town

SPACE = compose("front_car", []).front_car.space
POINTS = []
for row in SPACE.feasible_points():
    decoded = SPACE.space().decode(row.astype(float))
    POINTS.append({name: str(value) for name, value in decoded.items()})
ROAD = {"lanes": "2", "lane_orientation": "curvy"}
CURVY = [point for point in POINTS if ROAD.items() <= point.items()]
FORWARD, ONCOMING = CLASSES.index("forward vehicle"), CLASSES.index("oncoming vehicle")


@pytest.fixture(scope="module")
def shown() -> list[Snapshot]:
    return list(snapshots(5, [(point, (3, i)) for i, point in enumerate(CURVY)], CameraSettings()))


def test_snapshots_show_the_conditions_of_their_points(shown: list[Snapshot]) -> None:
    assert len(shown) == 24
    for point, snapshot in zip(CURVY, shown, strict=True):
        assert {name: snapshot.attributes[name] for name in point} == point
        assert (snapshot.truth.visible_box is not None) == (point["forward_vehicle"] == "present")
        assert bool((snapshot.classes == FORWARD).any()) == (point["forward_vehicle"] == "present")
        assert bool((snapshot.classes == ONCOMING).any()) == (
            point["oncoming_vehicle"] == "present"
        )
        assert (float(snapshot.attributes["rain"]) > 0) == (point["weather"] == "rainy")
        for part in ("sky", "road", "lane marking", "pavement", "building"):
            assert (snapshot.classes == CLASSES.index(part)).sum() > 50, (part, point)


def test_a_camera_that_cannot_show_the_vehicles_is_named(tmp_path: Path) -> None:
    camera = {**CameraSettings().model_dump(), "width": 64, "height": 64, "hfov_deg": 120.0}
    shots = [
        ({**CURVY[-1], "weather": kind}, (3,), "train", i)
        for i, kind in enumerate(("sunny", "cloudy", "rainy") * 4)
    ]
    with pytest.raises(
        InputError,
        match="^simulator.camera: no arrangement of .*; take more pixels or a narrower view$",
    ):
        render_town((5, shots, camera, tmp_path))  # type: ignore[arg-type]


def test_the_box_is_that_of_the_segmentation(shown: list[Snapshot]) -> None:
    for snapshot in shown:
        if snapshot.truth.visible_box is None:
            continue
        rows, columns = np.nonzero(snapshot.classes == FORWARD)
        assert snapshot.truth.visible_box == (
            columns.min(),
            rows.min(),
            columns.max() + 1,
            rows.max() + 1,
        )
        assert snapshot.truth.visible_pixels == len(rows)


def test_a_snapshot_does_not_depend_on_earlier_ones(shown: list[Snapshot]) -> None:
    chosen = (20, 3)
    again = list(snapshots(5, [(CURVY[i], (3, i)) for i in chosen], CameraSettings()))
    for i, snapshot in zip(chosen, again, strict=True):
        assert (snapshot.image == shown[i].image).all() and (
            snapshot.classes == shown[i].classes
        ).all()


@pytest.mark.parametrize("curvature", [1 / 80, -1 / 80])
def test_objects_in_a_curved_street_are_drawn_at_their_layout_positions(curvature: float) -> None:
    street = streets(Town(seed=1, curvature_1pm=curvature))[0]
    stage = Stage(Town(seed=1, curvature_1pm=curvature), {}, CameraSettings(vignetting=False))
    try:
        stage.reset(Weather(), "M 01")
        stage.pedestrian.hide()
        stage.put("ego", street.pose(0, -1.75))
        stage.shoot(np.random.default_rng(0))
        model, camera = stage.model, stage.camera
        classes = np.zeros(model.ngeom, np.uint8)
        surfaces = {model.material(name).id for name in ("road", "marking")}
        classes[[geom for geom in range(model.ngeom) if model.geom_matid[geom] in surfaces]] = 1
        asphalt = camera.segment(classes) == 1
        eye_x, eye_y = street.world(0, -1.75)[0] + 0.5, street.world(0, -1.75)[1]
        agreed = []
        for v in np.arange(-6, 6, 0.5):
            for u in (8.0, 12.0, 16.0):
                if abs(abs(v) - 3.5) < 0.3:
                    continue
                x, y = street.world(u, float(v))
                ahead, left = x - eye_x, y - eye_y
                column = round(160 - camera.focal_px * left / ahead)
                row = round(96 + camera.focal_px * 1.35 / ahead)
                if 0 <= column < 320 and row < 192:
                    agreed.append(asphalt[row, column] == (abs(v) < 3.5))
        assert len(agreed) > 30 and np.mean(agreed) > 0.97
    finally:
        stage.close()
