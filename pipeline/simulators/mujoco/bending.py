"""Bends a straight street along a curved axis: meshes by vertex, everything else as a whole."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from pipeline.core.paths import Piece, Pose
from pipeline.scenarios.streets import Street

Floats = NDArray[np.float64]


def bend(spec: mujoco.MjSpec, body: mujoco.MjsBody, street: Street) -> None:
    """Move everything in the frame of a street (u, v, z) onto its axis of constant curvature."""
    axis = Piece(Pose(0, 0, 0), np.inf, street.curvature)
    for geom in body.geoms:
        if geom.meshname.startswith(f"{street.name}_"):
            _bend_mesh(spec.mesh(geom.meshname), axis)
        elif not np.isnan(geom.fromto[0]):
            geom.fromto = np.concatenate(
                [_bent(axis, end) for end in np.asarray(geom.fromto).reshape(2, 3)]
            )
        else:
            heading = axis.at(float(geom.pos[0])).heading
            # A rotation followed by a turn to the left about the vertical.
            quat = np.asarray(geom.quat, float)
            result = np.empty(4)
            mujoco.mju_mulQuat(
                result, np.array([np.cos(heading / 2), 0, 0, np.sin(heading / 2)]), quat
            )
            geom.quat = result
            geom.pos = _bent(axis, np.asarray(geom.pos))


def _bend_mesh(mesh: mujoco.MjsMesh, axis: Piece) -> None:
    vertices, normals = (np.reshape(flat, (-1, 3)) for flat in (mesh.uservert, mesh.usernormal))
    heading = axis.curvature * vertices[:, 0]
    cos, sin = np.cos(heading), np.sin(heading)
    mesh.uservert = np.ravel([_bent(axis, vertex) for vertex in vertices])
    ahead, left, up = normals.T
    mesh.usernormal = np.column_stack(
        [cos * ahead - sin * left, sin * ahead + cos * left, up]
    ).ravel()


def _bent(axis: Piece, point: Floats) -> Floats:
    """A point (u, v, z) of the straight street on the curved one."""
    u, v, z = (float(value) for value in point)
    on = axis.at(u)
    return np.array([on.x - v * np.sin(on.heading), on.y + v * np.cos(on.heading), z])
