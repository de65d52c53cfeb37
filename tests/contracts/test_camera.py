"""The camera's geometry and ground truth are right, and each effect can be switched off."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import cv2
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.config.composing import functional_scenario
from pipeline.core.paths import Pose
from pipeline.scenarios.people import population
from pipeline.scenarios.streets import Town
from pipeline.simulators.mujoco import gait, model, pedestrian, textures
from pipeline.simulators.mujoco.backscatter import Backscatter
from pipeline.simulators.mujoco.camera import Camera, _contrast
from pipeline.simulators.mujoco.culling import HIDDEN_GROUP, Culling
from pipeline.simulators.mujoco.furniture import lamp_positions
from pipeline.simulators.mujoco.lens import CameraSettings, Lens
from pipeline.simulators.mujoco.mesh import Mesh
from pipeline.simulators.mujoco.stage import Stage
from pipeline.simulators.mujoco.weather import Weather

TOWN = Town(seed=1)
PLAIN: dict[str, Any] = {
    "exposure": False,
    "noise": False,
    "vignetting": False,
    "rain_on_lens": False,
}
SQUARES, SQUARE_M, BOARD_X, BOARD_Y, BOARD_Z = (9, 7), 0.5, 9.0, -1.0, 2.0


@pytest.mark.parametrize("distortion", [0.0, -0.15])
def test_a_checkerboard_is_seen_where_the_pinhole_model_says(distortion: float) -> None:
    settings = CameraSettings(width=640, height=384, distortion=distortion, **PLAIN)
    spec = model.describe(TOWN, {}, settings.vfov_deg, settings.width, settings.height)
    _add_board(spec)
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    camera = Camera(compiled, data, lamp_positions(TOWN), settings)
    camera.set_weather(Weather(sun_azimuth=180, sun_altitude=40))
    image, _ = camera.shoot(np.random.default_rng(0))
    camera.close()
    inner = (SQUARES[0] - 1, SQUARES[1] - 1)
    is_shown, corners = cv2.findChessboardCornersSB(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), inner)
    assert is_shown
    # OpenCV puts (0, 0) at the middle of the first pixel, we at its corner.
    seen = np.asarray(corners).reshape(-1, 2) + 0.5
    offset = (
        (np.arange(inner[0]) - (inner[0] - 1) / 2) * SQUARE_M,
        (np.arange(inner[1]) - (inner[1] - 1) / 2) * SQUARE_M,
    )
    left, up = np.meshgrid(BOARD_Y + offset[0], BOARD_Z + offset[1])
    depth = BOARD_X - model.CAMERA_X_M
    x, y = -left.ravel() / depth, -(up.ravel() - model.CAMERA_Z_M) / depth
    bent = 1 + distortion * (x**2 + y**2)
    focal = settings.width / 2 / np.tan(np.radians(settings.hfov_deg / 2))
    expected = np.stack(
        [settings.width / 2 + focal * x * bent, settings.height / 2 + focal * y * bent], -1
    )
    nearest = np.linalg.norm(expected[:, None] - seen[None], axis=-1).min(axis=1)
    assert nearest.max() < 0.5


@pytest.mark.parametrize(
    ("hfov_deg", "distortion"), [(60, -0.3), (70, -0.2), (120, -0.03), (120, 0.3)]
)
def test_every_accepted_distortion_is_inverted(hfov_deg: float, distortion: float) -> None:
    settings = CameraSettings(hfov_deg=hfov_deg, distortion=distortion)
    focal = settings.width / 2 / np.tan(np.radians(hfov_deg / 2))
    lens = Lens(settings, float(focal), 1.5)
    assert lens._distortion is not None
    x, y = (
        (source - middle + 0.5) / focal
        for source, middle in zip(lens._distortion, (160, 96), strict=True)
    )
    bent = 1 + distortion * (x**2 + y**2)
    u, v = np.meshgrid(np.arange(320) - 159.5, np.arange(192) - 95.5)
    assert np.abs(x * bent * focal - u).max() < 0.01 and np.abs(y * bent * focal - v).max() < 0.01
    edge = np.zeros((192, 320), np.uint8)
    edge[:, :3] = 1
    assert lens.distort(edge).sum() <= edge.sum()


def test_a_barrel_without_an_inverse_is_refused() -> None:
    with pytest.raises(
        ValueError,
        match=r"distortion must be at least -0\.109 for a field of view of 90 deg, got -0\.2",
    ):
        CameraSettings(hfov_deg=90, distortion=-0.2)


def test_freeing_a_camera_keeps_the_next_one_intact() -> None:
    def shot(stage: Stage) -> NDArray[np.uint8]:
        stage.camera.set_weather(Weather(sun_azimuth=180, sun_altitude=40))
        return stage.camera.shoot(np.random.default_rng(0))[0]

    stage = Stage(TOWN, {}, CameraSettings())
    expected = shot(stage)
    stage = Stage(TOWN, {}, CameraSettings())  # Frees the first camera.
    image = shot(stage)
    stage.close()
    assert (image == expected).all()


def test_two_stages_in_turn_give_the_same_images_as_alone() -> None:
    def shots(stage: Stage) -> list[NDArray[np.uint8]]:
        image, _ = stage.camera.shoot(np.random.default_rng(0))
        return [image, stage.camera.segment(np.ones(stage.model.ngeom, np.uint8))]

    first = Stage(TOWN, {}, CameraSettings())
    first.camera.set_weather(Weather(sun_azimuth=180, sun_altitude=40))
    alone = shots(first)
    second = Stage(Town(seed=2), {}, CameraSettings())
    second.camera.set_weather(Weather(sun_azimuth=0, sun_altitude=-20))
    again = shots(first)
    for stage in (first, second):
        stage.close()
    assert all((image == other).all() for image, other in zip(alone, again, strict=True))


def _add_board(spec: mujoco.MjSpec) -> None:
    """A checkerboard facing the camera, its middle at (BOARD_X, BOARD_Y, BOARD_Z)."""
    columns, rows = SQUARES
    pattern = (
        (np.indices((rows, columns)).sum(axis=0) % 2 * 230)
        .astype(np.uint8)
        .repeat(64, 0)
        .repeat(64, 1)
    )
    textures.add(spec, "board", np.repeat(pattern[..., None], 3, axis=2))
    board = Mesh()
    width, height = columns * SQUARE_M, rows * SQUARE_M
    board.quad(
        (BOARD_X, BOARD_Y + width / 2, BOARD_Z - height / 2),
        (0, -width, 0),
        (0, 0, height),
        (0, 1, 1, 0),
    )
    board.add_to(spec, "board")
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="board", material="board")


@pytest.fixture(scope="module")
def stage() -> Iterator[Stage]:
    stage = Stage(TOWN, {}, CameraSettings())
    yield stage
    stage.close()


def shot(
    stage: Stage, weather: Weather, name: str = "W 07", x: float = 10.0, y: float = -1.75
) -> tuple[np.ndarray, Any]:
    stage.reset(weather, name)
    stage.put("ego", Pose(0, -1.75, 0))
    stage.place_pedestrian(Pose(x, y, np.pi / 2), gait.pose("walking", 1.0, 1.4, stage.walker))
    return stage.shoot(np.random.default_rng(0))


@pytest.mark.parametrize(("x", "y"), [(6.0, -1.0), (14.0, -3.5), (30.0, 0.0)])
def test_the_visible_box_is_that_of_a_segmentation_render(stage: Stage, x: float, y: float) -> None:
    _, truth = shot(stage, Weather(), "M 05", x, y)
    camera, scene = stage.camera, mujoco.MjvScene(stage.model, 1500)
    scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
    view = mujoco.MjvCamera()
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, stage.model.camera("camera").id
    mujoco.mjv_updateScene(
        stage.model, stage.data, mujoco.MjvOption(), None, view, mujoco.mjtCatBit.mjCAT_ALL, scene
    )
    rect, image = mujoco.MjrRect(0, 0, 320, 192), np.empty((192, 320, 3), np.uint8)
    mujoco.mjr_render(rect, scene, camera.context)
    mujoco.mjr_readPixels(image, None, rect, camera.context)
    numbers = image[::-1].astype(np.int64) @ (1, 256, 65536) - 1
    mask = np.zeros(numbers.shape, bool)
    for i in range(scene.ngeom):
        geom = scene.geoms[i]
        if (
            geom.objtype == mujoco.mjtObj.mjOBJ_GEOM
            and stage.model.geom_group[geom.objid] == pedestrian.GROUP
        ):
            mask |= numbers == geom.segid
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    box = (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1)
    assert truth.visible_box is not None
    assert np.abs(np.subtract(box, truth.visible_box)).max() <= 1
    assert abs(int(mask.sum()) - truth.visible_pixels) <= 0.03 * mask.sum() + 2


def test_contrast_is_the_difference_to_the_median_of_the_ring_around_the_box() -> None:
    image = np.zeros((192, 320, 3), np.uint8)
    for beside, grey in (
        (4, 60),
        (2, 40),
        (0, 90),
    ):  # The outer half of the ring has more pixels than the inner one.
        image[70 - beside : 100 + beside, 100 - beside : 120 + beside] = grey
    image[70:80, 100:120] = 30
    assert _contrast(image, np.ones((30, 20), bool), 100, 70, (100.0, 70.0, 120.0, 100.0)) == 30
    assert _contrast(image, np.ones((192, 320), bool), 0, 0, (0.0, 0.0, 320.0, 192.0)) == 0


@pytest.mark.parametrize(
    "weather",
    [Weather(sun_azimuth=120, sun_altitude=30), Weather(fog=50, sun_altitude=-15)],
    ids=["day", "night"],
)
def test_leaving_out_what_is_not_in_view_changes_no_pixel(
    weather: Weather, monkeypatch: pytest.MonkeyPatch
) -> None:
    def images() -> list[bytes]:
        scenario = functional_scenario("F5")
        stage, route = Stage(scenario.town, scenario.actors, CameraSettings()), scenario.ego.route()
        stage.reset(weather, "W 07")
        stage.place_pedestrian(Pose(0, 0, 0), gait.pose("walking", 1.0, 1.4, stage.walker))
        taken = []
        for metres in range(20, 100, 10):
            stage.put("ego", route.at(metres))
            taken.append(stage.shoot(np.random.default_rng(0))[0].tobytes())
            hidden.append(int((stage.model.geom_group == HIDDEN_GROUP).sum()))
        stage.close()
        return taken

    hidden: list[int] = []
    culled = images()
    assert min(hidden) > 10
    monkeypatch.setattr(Culling, "apply", lambda *_: None)
    assert images() == culled


@pytest.fixture(scope="module")
def plain_stage() -> Iterator[Stage]:
    stage = Stage(TOWN, {}, CameraSettings(**PLAIN))
    yield stage
    stage.close()


def off_grey(stage: Stage, weather: Weather) -> float:
    """Mean difference between the pedestrian's middle and the colour of fog, grey levels."""
    image, truth = shot(stage, weather, x=14.0)
    left, top, right, bottom = (int(value) for value in truth.visible_box)
    middle = image[
        top + (bottom - top) // 4 : (top + bottom) // 2,
        (left + right) // 2 - 1 : (left + right) // 2 + 2,
    ]
    return float(np.abs(middle - 255 * weather.grey).mean())


def test_fog_and_rain_reduce_contrast(plain_stage: Stage) -> None:
    contrasts = [off_grey(plain_stage, Weather(fog=fog)) for fog in (0, 30, 60, 80, 100)]
    assert all(a > b for a, b in pairwise(contrasts))
    assert off_grey(plain_stage, Weather(rain=100)) < contrasts[0]


def test_twilight_ends_at_12_degrees_below_the_horizon_and_has_no_jump(plain_stage: Stage) -> None:
    images = {
        altitude: shot(plain_stage, Weather(sun_altitude=altitude))[0]
        for altitude in np.arange(-15, 12.1, 1.0)
    }
    assert (images[-15] == images[-12]).all()
    assert max(abs(np.diff([float(image.mean()) for image in images.values()]))) < 6
    skies = [float(image[:20, 100:200].mean()) for image in images.values()][3:26]
    assert min(np.diff(skies)) > 3
    before, after = (
        shot(plain_stage, Weather(sun_altitude=altitude))[0].astype(int)
        for altitude in (0.0, -0.01)
    )
    assert abs(before - after).mean() < 1


def test_daylight_follows_the_illuminance() -> None:
    weathers = [Weather(sun_altitude=altitude) for altitude in (60, 10, 0, -6, -12, -20)]
    assert [weather.daylight for weather in weathers] == pytest.approx(
        [1, 1, 0.58, 0.23, 0, 0], abs=0.005
    )
    assert [weather.lamplight for weather in weathers] == pytest.approx(
        [0, 0, 0, 0.39, 1, 1], abs=0.005
    )


def test_the_veil_is_the_integral_along_the_ray() -> None:
    weather, focal = Weather(fog=60, sun_altitude=-20), 277.0
    lens = Backscatter(320, 192, focal, model.CAMERA_Z_M)
    black = np.zeros((192, 320, 3), np.uint8)
    veil, near = (
        lens.add(black, np.full((192, 320), metres, np.float32), weather)[96, 160, 0]
        for metres in (200, 10)
    )
    s = (np.arange(200_000) + 0.5) / 2000  # Metres ahead of the camera, along the optical axis.
    ahead, aside, below = s + model.CAMERA_X_M - 2.3, 0.65, model.CAMERA_Z_M - 0.7
    away = np.sqrt(ahead**2 + aside**2 + below**2)
    cosine = (ahead + 0.035 * below) / away / np.hypot(1, 0.035)
    light = (
        2
        * 1.5
        * np.where(cosine > np.cos(np.radians(34)), np.abs(cosine) ** 9, 0)
        / (1 + 0.0016 * away**2)
    )
    extinction = weather.extinction_per_m
    gained = np.cumsum(light * np.exp(-extinction * (away + s))) / 2000 * extinction * np.pi / 18.8
    assert veil == pytest.approx(255 * gained[s < 64][-1], abs=2)
    assert near == pytest.approx(255 * gained[20_000], rel=0.2)


def test_fog_scatters_the_headlights_at_night_alone(plain_stage: Stage) -> None:
    clear, hazy, dense = (
        shot(plain_stage, Weather(fog=fog, sun_altitude=-20))[0].astype(int) for fog in (0, 40, 80)
    )
    ahead = [
        image[70:90, 150:170].mean() - 255 * Weather(sun_altitude=-20).grey.mean()
        for image in (hazy, dense)
    ]
    assert ahead[1] > ahead[0]
    assert dense[70:90, 150:170].mean() > dense[:20, :20].mean() + 20 > clear[:20, :20].mean()
    rainy = shot(plain_stage, Weather(rain=100, sun_altitude=-20))[0].astype(int)
    assert rainy[20:40, 150:170].mean() > rainy[20:40, :20].mean()
    by_day = Weather(fog=100, sun_altitude=20)
    assert shot(plain_stage, by_day)[0][60:90, 150:170].mean() < 255 * by_day.grey.mean()


@pytest.mark.parametrize(("altitude", "deviation"), [(40, 1.0), (-15, 1.7)])
def test_grain_is_new_in_each_frame_and_known_from_the_seed(
    altitude: float, deviation: float
) -> None:
    stage, plain = (
        Stage(TOWN, {}, CameraSettings(**{**PLAIN, "noise": noise})) for noise in (True, False)
    )
    weather = Weather(sun_altitude=altitude)
    clean = shot(plain, weather)[0].astype(int)
    shot(stage, weather)
    frames = [stage.shoot(np.random.default_rng(seed))[0].astype(int) for seed in (1, 2, 1)]
    stage.close()
    plain.close()
    assert (frames[0] == frames[2]).all() and (frames[0] != frames[1]).any()
    middle = (clean > 8) & (clean < 247)
    grain = [(frame - clean)[middle] for frame in frames[:2]]
    assert (
        np.std(grain[0]) == pytest.approx(np.hypot(deviation, 12**-0.5), rel=0.03)
        and abs(np.mean(grain[0])) < 0.02
    )
    assert abs(np.corrcoef(grain)[0, 1]) < 0.02


@pytest.mark.parametrize(
    "weather",
    [
        Weather(rain=100, sun_altitude=30),
        Weather(rain=80, fog=40, sun_altitude=-20),
        Weather(sun_azimuth=5, sun_altitude=9),
    ],
    ids=["rain", "night", "glare"],
)
def test_a_larger_image_shows_the_same_weather(weather: Weather) -> None:
    images = []
    for width, height in ((320, 192), (640, 384)):
        stage = Stage(TOWN, {}, CameraSettings(width=width, height=height, noise=False))
        image = shot(stage, weather, x=9.0)[0]
        stage.close()
        images.append(cv2.resize(image, (320, 192), interpolation=cv2.INTER_AREA).astype(int))
    smooth = [cv2.blur(image.astype(np.float32), (5, 5)) for image in images]
    assert abs(smooth[0] - smooth[1]).mean() < 2
    assert np.std(images[1]) == pytest.approx(np.std(images[0]), rel=0.05)


def test_glare_comes_from_the_sun_s_direction(plain_stage: Stage) -> None:
    ahead, behind = (
        shot(plain_stage, Weather(sun_azimuth=azimuth, sun_altitude=13))[0].astype(int)
        for azimuth in (0.0, 180.0)
    )
    assert ahead[10:60, 140:180].mean() > behind[10:60, 140:180].mean() + 20
    left, right = (
        shot(plain_stage, Weather(sun_azimuth=azimuth, sun_altitude=8))[0].max(axis=2)
        for azimuth in (18.0, 342.0)
    )
    assert np.argmax(left[20:60].mean(axis=0)) < 160 < np.argmax(right[20:60].mean(axis=0))


@pytest.mark.parametrize(
    "effect", ["exposure", "noise", "vignetting", "rain_on_lens", "distortion", "jpeg_quality"]
)
def test_each_camera_effect_changes_the_image_and_can_be_switched_off(effect: str) -> None:
    plain = CameraSettings(**PLAIN)
    value: Any = {"distortion": 0.1, "jpeg_quality": 60}.get(effect, True)
    weather, images = Weather(rain=70, sun_altitude=-10), []
    for settings in (plain, CameraSettings(**{**PLAIN, effect: value})):
        stage = Stage(TOWN, {}, settings)
        images.append(shot(stage, weather)[0].astype(int))
        stage.close()
    assert (images[0] != images[1]).any()


def test_blueprints_look_different(stage: Stage) -> None:
    names = [*population(1), *population(2)]
    shown = {name: shot(stage, Weather(), name, x=6.0)[0] for name in names}
    assert len({image.tobytes() for image in shown.values()}) == len(names) == 148
