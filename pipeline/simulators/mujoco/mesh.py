"""Triangle meshes for MuJoCo, built from quads with their own normals and texture coordinates."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass
class Mesh:
    """Quads gathered into one mesh, so a whole street of facades is one draw call."""

    vertices: list[Floats] = field(default_factory=list)
    normals: list[Floats] = field(default_factory=list)
    texcoords: list[Floats] = field(default_factory=list)
    faces: list[tuple[int, int, int]] = field(default_factory=list)

    def quad(
        self,
        origin: ArrayLike,
        edge_u: ArrayLike,
        edge_v: ArrayLike,
        uv: tuple[float, float, float, float],
        cell: float = 4.0,
    ) -> None:
        """Add a rectangle: corner and two edges in metres, texture window (u0, v0, u1, v1).

        V = 0 is an image's top row.

        It is split into cells of at most `cell` metres, because MuJoCo's classic renderer lights
        vertices, not pixels.
        """
        o, a, b = (np.asarray(x, float) for x in (origin, edge_u, edge_v))
        normal = np.cross(a, b)
        normal /= np.linalg.norm(normal)
        nu, nv = (max(1, int(np.ceil(np.linalg.norm(e) / cell))) for e in (a, b))
        first = len(self.vertices)
        for i in range(nu + 1):
            for j in range(nv + 1):
                s, t = i / nu, j / nv
                self.vertices.append(o + s * a + t * b)
                self.normals.append(normal)
                self.texcoords.append(
                    np.array([uv[0] + s * (uv[2] - uv[0]), uv[1] + t * (uv[3] - uv[1])])
                )
        for i in range(nu):
            for j in range(nv):
                k = first + i * (nv + 1) + j
                self.faces += [(k, k + nv + 1, k + nv + 2), (k, k + nv + 2, k + 1)]

    def triangle(self, corners: ArrayLike, texcoords: ArrayLike) -> None:
        """Add one triangle, (3, 3) metres and (3, 2) texture coordinates."""
        points, uv = np.asarray(corners, float), np.asarray(texcoords, float)
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        first = len(self.vertices)
        self.vertices += list(points)
        self.normals += [normal / np.linalg.norm(normal)] * 3
        self.texcoords += list(uv)
        self.faces.append((first, first + 1, first + 2))

    def add_to(self, spec: mujoco.MjSpec, name: str) -> None:
        """Declare the mesh as an asset of the model."""
        mesh = spec.add_mesh(name=name)
        mesh.uservert = np.concatenate(self.vertices)
        mesh.usernormal = np.concatenate(self.normals)
        mesh.usertexcoord = np.concatenate(self.texcoords)
        flat = np.array(self.faces, dtype=np.int32).ravel()
        mesh.userface = mesh.userfacenormal = mesh.userfacetexcoord = flat
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def loft(spec: mujoco.MjSpec, name: str, sections: ArrayLike) -> None:
    """Declare a closed skin over cross-sections, (stations, points, 3) metres.

    MuJoCo makes its smooth normals.
    """
    rings = np.asarray(sections, float)
    stations, points = rings.shape[:2]
    faces: list[tuple[int, int, int]] = []
    for i in range(stations - 1):
        for j in range(points):
            a, b = i * points + j, i * points + (j + 1) % points
            faces += [(a, b, b + points), (a, b + points, a + points)]
    for ring, flip in ((0, True), (stations - 1, False)):
        base = ring * points
        for j in range(1, points - 1):
            fan = (base, base + j, base + j + 1)
            faces.append((fan[0], fan[2], fan[1]) if flip else fan)
    mesh = spec.add_mesh(name=name)
    mesh.uservert = rings.ravel()
    mesh.userface = np.array(faces, dtype=np.int32).ravel()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


@dataclass(frozen=True)
class Site:
    """Target of a street's geometry: the model that declares its meshes, and their body."""

    spec: mujoco.MjSpec
    body: mujoco.MjsBody

    def put(self, name: str, mesh: Mesh, material: str) -> None:
        """Declare a mesh and attach it to the body in the modelled pose."""
        mesh.add_to(self.spec, name)
        place(self.body, name, material)


def place(body: mujoco.MjsBody, mesh: str, material: str, shadow: bool = False) -> None:
    """Attach a mesh to a body in the modelled pose."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, material=material, castshadow=shadow
    )
