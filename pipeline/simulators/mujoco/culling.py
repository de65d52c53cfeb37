"""Leaves out what the camera cannot see: MuJoCo's renderer transforms every geom of the scene."""

from __future__ import annotations

import mujoco
import numpy as np

VISIBLE_GROUP, HIDDEN_GROUP = 0, 5
"""Geom groups: MuJoCo draws 0 to 2 by default."""


class Culling:
    """Hides streets and vehicles whose bounding sphere lies outside the view.

    No pixel changes: whatever casts a shadow stays.
    """

    def __init__(
        self, model: mujoco.MjModel, camera: int, half_width: float, half_height: float
    ) -> None:
        """half_width, half_height: of the view, per metre of depth."""
        self._model, self._camera = model, camera
        # The pedestrian's geoms change their size with the person, but not their bounding spheres.
        person = model.body_rootid[model.geom_bodyid] == model.body("pedestrian").id
        self._geoms = np.flatnonzero((model.geom_group == VISIBLE_GROUP) & ~person)
        self._radius = model.geom_rbound[self._geoms]
        self._casts = model.geom_castshadow[self._geoms].astype(bool)
        self._normals = np.array(
            [(sign * 1.0, 0, half_width) for sign in (1, -1)]
            + [(0, sign * 1.0, half_height) for sign in (1, -1)]
        ).T
        self._normals /= np.linalg.norm(self._normals, axis=0)

    def apply(self, data: mujoco.MjData, shadows: bool) -> None:
        """Hide and show geoms for the camera's present pose."""
        axes = data.cam_xmat[self._camera].reshape(3, 3)
        centres = (data.geom_xpos[self._geoms] - data.cam_xpos[self._camera]) @ axes
        hidden = (centres @ self._normals > self._radius[:, None]).any(axis=1)
        if shadows:
            hidden &= ~self._casts
        self._model.geom_group[self._geoms] = np.where(hidden, HIDDEN_GROUP, VISIBLE_GROUP)
