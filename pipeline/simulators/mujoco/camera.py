"""Renders one frame with its ground truth.

Colour and depth come in one read, the pedestrian alone in a second small pass.
"""

from __future__ import annotations

import weakref

import mujoco
import numpy as np
from numpy.typing import NDArray

from pipeline.core.boxes import Box
from pipeline.core.truth import Truth
from pipeline.errors import SimulationError
from pipeline.simulators.gl import lost_context
from pipeline.simulators.mujoco.culling import Culling
from pipeline.simulators.mujoco.lens import CameraSettings, Lens, Sun
from pipeline.simulators.mujoco.pedestrian import GROUP
from pipeline.simulators.mujoco.weather import Weather, WeatherControl

MAX_GEOMS = 1500
DEPTH_TOLERANCE = 1e-4
RING = 4 / 320
"""Width of the ring around the pedestrian's box that contrast is measured against, as a share of
the image's."""


class Camera:
    """The ego's camera on one compiled model; owns a GL context."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        lamps: NDArray[np.float64],
        settings: CameraSettings,
    ) -> None:
        width, height = settings.width, settings.height
        self._model, self._data, self._size = model, data, (width, height)
        try:
            self._gl = mujoco.GLContext(width, height)
            self._gl.make_current()
        except Exception as error:  # MuJoCo and PyOpenGL raise many kinds.
            raise lost_context(error) from error
        self.context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        # MuJoCo frees the buffers of the current GL context, which may be another camera's.
        self._release = weakref.finalize(self, _free, self._gl, self.context)
        self.context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.context)
        self._scene, self._alone = mujoco.MjvScene(model, MAX_GEOMS), mujoco.MjvScene(model, 64)
        self._alone.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = self._alone.flags[
            mujoco.mjtRndFlag.mjRND_IDCOLOR
        ] = 1
        self._all, self._only = mujoco.MjvOption(), mujoco.MjvOption()
        self._only.geomgroup[:] = 0
        self._only.geomgroup[GROUP] = 1
        self._view = mujoco.MjvCamera()
        self._view.type, self._view.fixedcamid = (
            mujoco.mjtCamera.mjCAMERA_FIXED,
            model.camera("camera").id,
        )
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._rgb, self._depth = (
            np.empty((height, width, 3), np.uint8),
            np.empty((height, width), np.float32),
        )
        self._near, self._far = np.float32(model.vis.map.znear), np.float32(model.vis.map.zfar)
        self.focal_px = height / 2 / np.tan(np.radians(model.cam_fovy[self._view.fixedcamid]) / 2)
        self._culling = Culling(
            model, self._view.fixedcamid, width / 2 / self.focal_px, height / 2 / self.focal_px
        )
        self._weather_control = WeatherControl(model, lamps)
        self._lens = Lens(
            settings, float(self.focal_px), float(model.cam_pos[self._view.fixedcamid, 2])
        )
        self._weather = Weather()
        self._pedestrian_geoms = np.flatnonzero(model.geom_group == GROUP)

    def set_weather(self, weather: Weather) -> None:
        """Prepare the scene for an episode in this weather."""
        self._weather = weather
        self._gl.make_current()
        self._weather_control.apply(weather, self.context)
        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = weather.sunshine > 0.12
        flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = flags[mujoco.mjtRndFlag.mjRND_FOG] = flags[
            mujoco.mjtRndFlag.mjRND_HAZE
        ] = 0

    def shoot(self, rng: np.random.Generator) -> tuple[NDArray[np.uint8], Truth]:
        """Render the present state: (h, w, 3) uint8 RGB and the pedestrian's ground truth."""
        model, data = self._model, self._data
        self._gl.make_current()
        mujoco.mj_kinematics(model, data)
        self._weather_control.follow(
            data.body("ego").xpos[:2], data.body("ego").xmat[[0, 3]], self._weather
        )
        mujoco.mj_camlight(model, data)
        self._culling.apply(data, bool(self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW]))
        mujoco.mjv_updateScene(
            model, data, self._all, None, self._view, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        if self._scene.status:
            raise SimulationError(f"the scene has more than {MAX_GEOMS} geoms")
        mujoco.mjr_render(self._rect, self._scene, self.context)
        mujoco.mjr_readPixels(self._rgb, self._depth, self._rect, self.context)
        near, far = self._near, self._far
        distance = near * far / (near + self._depth[::-1] * (far - near))
        sun = Sun(
            data.cam_xmat[self._view.fixedcamid].reshape(3, 3).T @ self._weather.sun_direction,
            self._sun_hidden(),
        )
        image = self._lens.expose(
            np.ascontiguousarray(self._rgb[::-1]), distance, self._weather, sun, rng
        )
        return image, self._truth(image)

    def segment(self, classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Class of each pixel of the last shot, (h, w).

        classes: (ngeom,) of the model's geoms; the sky is 0.
        """
        self._gl.make_current()
        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
        mujoco.mjr_render(self._rect, self._scene, self.context)
        flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 0
        colours = np.empty((self._size[1], self._size[0], 3), np.uint8)
        mujoco.mjr_readPixels(colours, None, self._rect, self.context)
        numbers = colours[::-1].astype(np.int32) @ np.array([1, 1 << 8, 1 << 16], np.int32)
        numbered = np.zeros(self._scene.ngeom + 1, np.uint8)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                numbered[geom.segid + 1] = classes[geom.objid]
        return self._lens.distort(numbered[numbers])

    def truth_of(self, image: NDArray[np.uint8], visible: NDArray[np.bool_]) -> Truth:
        """The ground truth of an unoccluded object that covers the pixels `visible`, (h, w)."""
        box, pixels = _box(visible, 0, 0), int(visible.sum())
        return Truth(box, box, pixels, pixels, _contrast(image, visible, 0, 0, box) if box else 0.0)

    def _sun_hidden(self) -> bool:
        if self._weather.sunshine <= 0:
            return True
        geom = np.zeros(1, np.int32)
        eye = self._data.cam_xpos[self._view.fixedcamid]
        return bool(
            mujoco.mj_ray(
                self._model, self._data, eye, self._weather.sun_direction, None, 1, -1, geom
            )
            >= 0
        )

    def _truth(self, image: NDArray[np.uint8]) -> Truth:
        window = self._pedestrian_window()
        if window is None:
            return Truth()
        x0, y0, x1, y1 = window  # GL's rows run upwards.
        mujoco.mjv_updateScene(
            self._model,
            self._data,
            self._only,
            None,
            self._view,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._alone,
        )
        mujoco.mjr_render(self._rect, self._alone, self.context)
        alone = np.empty((y1 - y0, x1 - x0), np.float32)
        mujoco.mjr_readPixels(None, alone, mujoco.MjrRect(x0, y0, x1 - x0, y1 - y0), self.context)
        whole = alone > 0
        visible = whole & (self._depth[y0:y1, x0:x1] <= alone * (1 + DEPTH_TOLERANCE) + 1e-7)
        whole, visible = whole[::-1], visible[::-1]
        top = self._size[1] - y1
        if self._lens.distorts:
            whole, visible, x0, top = self._bent(whole, x0, top), self._bent(visible, x0, top), 0, 0
        box = _box(visible, x0, top)
        contrast = _contrast(image, visible, x0, top, box) if box else 0.0
        return Truth(box, _box(whole, x0, top), int(visible.sum()), int(whole.sum()), contrast)

    def _bent(self, mask: NDArray[np.bool_], left: int, top: int) -> NDArray[np.bool_]:
        """The mask of a window after lens distortion, (h, w) of the whole image."""
        whole = np.zeros((self._size[1], self._size[0]), np.uint8)
        whole[top : top + mask.shape[0], left : left + mask.shape[1]] = mask
        return self._lens.distort(whole) > 0

    def _pedestrian_window(self) -> tuple[int, int, int, int] | None:
        """Pixel window (GL rows) that contains the pedestrian's projected bounding spheres.

        None if they miss the image.
        """
        width, height = self._size
        camera = self._view.fixedcamid
        axes = self._data.cam_xmat[camera].reshape(3, 3)
        centres = (
            self._data.geom_xpos[self._pedestrian_geoms] - self._data.cam_xpos[camera]
        ) @ axes
        # rbound is for the reference height; parts of people reach 1.374 times that.
        radius = 1.4 * self._model.geom_rbound[self._pedestrian_geoms]
        depth = -centres[:, 2]
        if depth.max() < 0.2:
            return None
        nearest, middle = np.maximum(depth - radius, 0.15), np.maximum(depth, 0.15)
        u, v = self.focal_px * centres[:, 0] / middle, self.focal_px * centres[:, 1] / middle
        reach = self.focal_px * radius / nearest
        x0, x1 = (
            max(0, int((u - reach).min() + width / 2) - 1),
            min(width, int((u + reach).max() + width / 2) + 2),
        )
        y0, y1 = (
            max(0, int((v - reach).min() + height / 2) - 1),
            min(height, int((v + reach).max() + height / 2) + 2),
        )
        return (x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None

    def close(self) -> None:
        """Free the GL context, as deleting the camera does."""
        self._release()


def _free(gl: mujoco.GLContext, context: mujoco.MjrContext) -> None:
    with gl.as_current():
        context.free()
    gl.free()


def _box(mask: NDArray[np.bool_], left: int, top: int) -> Box | None:
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return None
    return (
        float(left + columns[0]),
        float(top + rows[0]),
        float(left + columns[-1] + 1),
        float(top + rows[-1] + 1),
    )


def _contrast(
    image: NDArray[np.uint8], visible: NDArray[np.bool_], left: int, top: int, box: Box
) -> float:
    """Mean grey-level difference of the visible pixels from the median ring around their box."""
    height, width = image.shape[:2]
    ring = max(1, round(RING * width))
    x0, y0 = max(0, int(box[0]) - ring), max(0, int(box[1]) - ring)
    x1, y1 = min(width, int(box[2]) + ring), min(height, int(box[3]) + ring)
    grey = image[y0:y1, x0:x1].mean(axis=2)
    inside = np.zeros(grey.shape, bool)
    rows, columns = np.nonzero(visible)
    inside[rows + top - y0, columns + left - x0] = True
    if inside.all():
        return 0.0
    return float(np.abs(grey[inside] - np.median(grey[~inside])).mean())
