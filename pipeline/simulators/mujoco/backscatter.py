"""The light of the ego's headlights that fog and rain scatter back into the camera."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.simulators.mujoco.model import (
    CAMERA_X_M,
    HEADLIGHT_AXIS,
    HEADLIGHT_COLOUR,
    HEADLIGHT_CUTOFF_DEG,
    HEADLIGHT_EXPONENT,
    HEADLIGHT_FADE,
    HEADLIGHTS_M,
)
from pipeline.simulators.mujoco.weather import Weather

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]
SCATTERED_PER_SR = 1 / 18.8
"""Share of the scattered light that droplets send straight back, per steradian: the lidar ratio of
water cloud (O'Connor et al. 2004, doi:10.1175/1520-0426(2004)021<0777:ATFAOC>2.0.CO;2)."""
COLUMNS, SAMPLES = 40, 32
NEAREST_M, FARTHEST_M = 0.5, 64.0
STEPS_PER_M = 4.0


class Backscatter:
    """The veil of scattered headlight at one image size: single scattering along each pixel's ray.

    L(s) = b p integral from 0 to s of E(d, a) exp(-b (d + t)) dt: extinction b, share scattered
    back p, distances t from the camera and d from the lamp, angle a from the beam's axis (Sun et
    al. 2005, doi:10.1145/1073204.1073309). E is the light that the renderer's spotlight gives, so
    that veil and lit surfaces are exposed alike. Split into a map of the image for an empty road
    and the share gained up to a distance, L(s) = L(inf) F(s), this costs a look-up and a product
    per pixel.
    """

    def __init__(self, width: int, height: int, focal_px: float, camera_height_m: float) -> None:
        self._size = width, height
        rows, pixel = max(1, round(COLUMNS * height / width)), width / COLUMNS
        u, v = np.meshgrid(np.arange(COLUMNS) + 0.5 - COLUMNS / 2, np.arange(rows) + 0.5 - rows / 2)
        rays = np.stack([np.ones_like(u), -u * pixel / focal_px, -v * pixel / focal_px], -1)
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        edges = np.geomspace(NEAREST_M, FARTHEST_M, SAMPLES + 1)
        self._metres = np.sqrt(edges[1:] * edges[:-1])
        points = rays * self._metres[:, None, None, None] + (CAMERA_X_M, 0, camera_height_m)
        beams = [_beam(points - position) for position in HEADLIGHTS_M.values()]
        self._gained = sum(light for light, _ in beams) * np.diff(edges)[:, None, None]
        self._way = beams[0][1] + self._metres[:, None, None]
        self._of = lru_cache(maxsize=1)(self._maps)

    def add(self, image: Image, metres: Floats, weather: Weather) -> Image:
        """The image, (h, w, 3), with the veil in front of what lies `metres`, (h, w), away."""
        veil, gained = self._of(weather.extinction_per_m, weather.lamplight)
        share = cv2.LUT(cv2.convertScaleAbs(metres, alpha=STEPS_PER_M), gained)
        return np.asarray(
            cv2.add(
                image, cv2.multiply(veil, cv2.cvtColor(share, cv2.COLOR_GRAY2RGB), scale=1 / 255)
            ),
            np.uint8,
        )

    def _maps(self, extinction_per_m: float, lamplight: float) -> tuple[Image, Image]:
        """L(inf), (h, w, 3) grey levels, and F, (256,) of 0 to 255 every 1 / STEPS_PER_M metres."""
        gained = np.cumsum(self._gained * np.exp(-extinction_per_m * self._way), axis=0)
        whole = extinction_per_m * np.pi * SCATTERED_PER_SR * lamplight * gained[-1]
        white = cv2.resize(whole.astype(np.float32), self._size, interpolation=cv2.INTER_CUBIC)
        veil = white[..., None] * np.array(HEADLIGHT_COLOUR, np.float32)
        share = np.interp(
            np.arange(256) / STEPS_PER_M,
            self._metres,
            gained.sum(axis=(1, 2)) / gained[-1].sum(),
            left=0,
        )
        return np.clip(255 * veil, 0, 255).astype(np.uint8), np.round(255 * share).astype(np.uint8)


def _beam(offsets: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Light of one lamp, as the renderer's spotlight, and metres from it at (..., 3) places.

    The places are relative to the lamp.
    """
    metres = np.maximum(np.linalg.norm(offsets, axis=-1), 0.1)
    cosine = np.clip(
        offsets @ (np.array(HEADLIGHT_AXIS) / np.linalg.norm(HEADLIGHT_AXIS)) / metres, 0, 1
    )
    spot = np.where(
        cosine > np.cos(np.radians(HEADLIGHT_CUTOFF_DEG)), cosine**HEADLIGHT_EXPONENT, 0
    )
    return spot / (1 + HEADLIGHT_FADE * metres**2), metres
