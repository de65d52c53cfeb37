"""What happens between the scene and the sensor: fog, glare, rain and night noise, on uint8 images."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .weather import Weather

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]
NOISE_GREY_LEVELS = 2.2
STREAK_SHEETS = 6
GLARE_HIDDEN = 0.2
"""Share of the glare that is left while something hides the sun: the bright sky around it."""


class Lens:
    """Camera effects at one image size. Everything random comes from the generator passed to `expose`."""

    def __init__(self, width: int, height: int, focal_px: float) -> None:
        self._width, self._height, self._focal = width, height, focal_px
        u, v = np.meshgrid(np.arange(width) - width / 2 + 0.5, np.arange(height) - height / 2 + 0.5)
        # Fog grows with the distance along the ray, not with the depth.
        self._ray = np.sqrt(1 + (u**2 + v**2) / focal_px**2).astype(np.float32)
        self._glow = _glow(width, height)
        rng = np.random.default_rng(3)
        self._streaks = [_streaks(width, height, rng) for _ in range(STREAK_SHEETS)]
        grain = np.round(rng.normal(0, NOISE_GREY_LEVELS, (2 * height, 2 * width, 1))).astype(np.int16)
        self._grain = np.repeat(grain, 3, axis=2)

    def expose(
        self, image: Image, distance: Floats, weather: Weather, sun: NDArray[np.float64], sun_hidden: bool, rng: np.random.Generator
    ) -> Image:
        """Apply the weather to a rendered image.

        image: (h, w, 3). distance: (h, w) metres of depth. sun: (3,) unit vector to the sun in the camera frame (x right, y up, -z ahead).
        """
        image = self._fog(image, distance, weather)
        image = self._glare(image, weather, sun, sun_hidden)
        if weather.rain > 0:
            image = self._rain(image, weather, rng)
        if weather.night:
            y, x = rng.integers(self._height), rng.integers(self._width)
            image = cv2.add(image, self._grain[y : y + self._height, x : x + self._width], dtype=cv2.CV_8U)
        return image

    def _fog(self, image: Image, distance: Floats, weather: Weather) -> Image:
        if weather.fog <= 0 and weather.rain <= 0:
            return image
        clear = cv2.exp(distance * self._ray * np.float32(-weather.extinction_per_m))
        veil = np.empty_like(image)
        veil[:] = np.clip(255 * weather.grey, 0, 255)
        return np.asarray(cv2.blendLinear(image, veil, clear, 1 - clear), np.uint8)

    def _glare(self, image: Image, weather: Weather, sun: NDArray[np.float64], hidden: bool) -> Image:
        strength = 230 * weather.sunshine * (GLARE_HIDDEN if hidden else 1.0)
        if strength < 1 or sun[2] > -0.05:
            return image
        x = int(self._width / 2 - self._focal * sun[0] / sun[2])
        y = int(self._height / 2 + self._focal * sun[1] / sun[2])
        left, top = self._width - x, self._height - y
        if not (0 <= left <= self._width and 0 <= top <= self._height):
            return image
        glow = self._glow[top : top + self._height, left : left + self._width]
        return np.asarray(cv2.add(image, cv2.convertScaleAbs(glow, alpha=strength)), np.uint8)

    def _rain(self, image: Image, weather: Weather, rng: np.random.Generator) -> Image:
        share = weather.rain / 100
        sheet = self._streaks[rng.integers(STREAK_SHEETS)]
        y, x = rng.integers(self._height), rng.integers(self._width)
        alpha = sheet[y : y + self._height, x : x + self._width] * np.float32(share * (0.35 if weather.night else 0.6))
        drops = np.empty_like(image)
        drops[:] = np.clip(255 * (0.7 * weather.grey + (0.2 if weather.night else 0.3)), 0, 255)
        image = cv2.blendLinear(image, drops, 1 - alpha, alpha)
        if share > 0.3:
            blurred = cv2.GaussianBlur(image, (0, 0), 0.9 * share * self._width / 320)
            image = cv2.addWeighted(image, 1 - 0.5 * share, blurred, 0.5 * share, 0)
        return image


def _glow(width: int, height: int) -> Floats:
    """(2h, 2w, 3) glare around its centre, 0 to about 2: a disc, a halo and a veil over the lens."""
    v, u = np.mgrid[-height:height, -width:width].astype(np.float32)
    r = np.sqrt(u**2 + v**2) / width
    shape = 1.2 * np.exp(-((r / 0.022) ** 2)) + 0.7 * np.exp(-r / 0.09) + 0.22 * np.exp(-r / 0.45)
    return np.asarray(shape[..., None] * np.array([1, 0.95, 0.82]), np.float32)


def _streaks(width: int, height: int, rng: np.random.Generator) -> Floats:
    """(2h, 2w) opacity of falling drops, tiled so that any window of the image size shows a different shower."""
    sheet = np.zeros((2 * height, 2 * width), np.float32)
    for _ in range(width * height // 90):
        x, y, length = rng.integers(2 * width), rng.integers(2 * height), int(rng.integers(height // 26, height // 9))
        steps = np.arange(length)
        sheet[(y + steps) % (2 * height), (x + (0.12 * steps).astype(int)) % (2 * width)] = rng.uniform(0.15, 0.6) * np.sin(
            np.pi * (steps + 0.5) / length
        )
    return sheet
