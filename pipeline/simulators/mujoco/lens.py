"""Image effects on uint8 images: fog, glare, rain and the camera itself."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor
from statistics import NormalDist

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, field_validator, model_validator

from pipeline.scenarios.parts import STRICT
from pipeline.simulators.mujoco.backscatter import Backscatter
from pipeline.simulators.mujoco.model import TIMESTEP_S
from pipeline.simulators.mujoco.weather import Weather

ROUNDED = 1e-3
"""A rate may be rounded by this share, such as 28.57 for every seventh step."""


class CameraSettings(BaseModel):
    """The camera and its image effects.

    Attributes:
        width: of the image, pixels.
        height: of the image, pixels.
        hfov_deg: horizontal field of view, degrees.
        rate_hz: images per second.
        exposure: gain that follows the image's brightness.
        noise: sensor noise.
        vignetting: darker corners.
        rain_on_lens: drops.
        distortion: radial coefficient k1 of Brown's model (x_d = x (1 + k1 r^2), normalised image
            plane); negative is barrel, 0 none. A barrel shows more than the rendered image: its
            border repeats the outermost pixels. The car places detections on the road as if there
            were no distortion.
        jpeg_quality: of the image's compression; null for none.
    """

    model_config = STRICT

    width: int = Field(default=320, ge=64, le=1920, multiple_of=32)
    height: int = Field(default=192, ge=64, le=1088, multiple_of=32)
    hfov_deg: float = Field(default=60, ge=20, le=120)
    rate_hz: float = Field(default=10, ge=2, le=50)
    exposure: bool = True
    noise: bool = True
    vignetting: bool = True
    rain_on_lens: bool = True
    distortion: float = Field(default=0, ge=-0.3, le=0.3)
    jpeg_quality: int | None = Field(default=None, ge=10, le=100)

    @field_validator("rate_hz")
    @classmethod
    def _whole_steps(cls, rate_hz: float) -> float:
        """An image is taken after a whole number of the simulator's steps."""
        steps = 1 / rate_hz / TIMESTEP_S
        if abs(steps - round(steps)) > ROUNDED * steps:
            nearest = " or ".join(
                f"{1 / TIMESTEP_S / count:.5g}" for count in (ceil(steps), floor(steps))
            )
            raise ValueError(
                f"expected a whole number of {1000 * TIMESTEP_S:g} ms steps between two images, "
                f"as at {nearest} Hz, got {rate_hz:g}"
            )
        return rate_hz

    @model_validator(mode="after")
    def _barrel_can_be_inverted(self) -> CameraSettings:
        corner = np.tan(np.radians(self.hfov_deg / 2)) ** 2 * (1 + (self.height / self.width) ** 2)
        # The value for which x_d (x) has its maximum at the image's corner.
        least = -4 / (27 * corner)
        if self.distortion < least:
            raise ValueError(
                f"distortion must be at least {least:.3f} for a field of view of "
                f"{self.hfov_deg:g} deg, got {self.distortion}"
            )
        return self

    @property
    def vfov_deg(self) -> float:
        return float(
            2
            * np.degrees(
                np.arctan(np.tan(np.radians(self.hfov_deg / 2)) * self.height / self.width)
            )
        )


@dataclass(frozen=True)
class Sun:
    """direction: (3,) unit vector to the sun in the camera frame (x right, y up, -z ahead).

    hidden: whether an object is in front of it.
    """

    direction: NDArray[np.float64]
    hidden: bool


Image = NDArray[np.uint8]
Floats = NDArray[np.float32]
GRAIN_DAY, GRAIN_NIGHT = 1.0, 1.7
"""Standard deviation of the sensor's noise before the exposure's gain, grey levels. It is the same
for bright and dark pixels, because a gamma of about 2 turns photon noise, the square root of the
light, into a constant."""
STREAK_SHEETS = 6
REFERENCE_WIDTH = 320
"""Image width that streaks, blurs and rings in pixels are made for; they grow with the image, so
that each size shows the same weather."""
GLARE_HIDDEN = 0.2
"""Share of the glare that remains while the sun is hidden, from the bright sky around it."""
QUANTILES = np.array([NormalDist().inv_cdf((i + 0.5) / 256) for i in range(256)])
"""Of the standard normal distribution: a random byte chooses one."""
MEAN_GREY, GAINS = 100.0, (0.8, 1.3)
"""Target of the exposure, and the limits of its gain."""
DROPS_FROM_RAIN, DROP_LEVELS = 20.0, 6
WET_MIRROR, GROUND_M = 0.4, 0.15
"""Share of light that a wet road mirrors at a flat angle; height up to which a surface counts as
ground."""
CORNER_LIGHT = 0.78
"""Share of the light that reaches the image's corners."""


class Lens:
    """Camera effects at one image size.

    All randomness comes from the generator passed to `expose`.
    """

    def __init__(self, settings: CameraSettings, focal_px: float, camera_height_m: float) -> None:
        width, height = settings.width, settings.height
        self._settings = settings
        self._width, self._height, self._focal = width, height, focal_px
        self._scale = width / REFERENCE_WIDTH
        u, v = np.meshgrid(np.arange(width) - width / 2 + 0.5, np.arange(height) - height / 2 + 0.5)
        # Fog grows with the distance along the ray, not with the depth.
        self._ray = np.sqrt(1 + (u**2 + v**2) / focal_px**2).astype(np.float32)
        self._fall = (np.maximum(v[height // 2 :], 0) / focal_px).astype(np.float32)
        self._camera_height = camera_height_m
        self._glow = _glow(width, height)
        self._backscatter = Backscatter(width, height, focal_px, camera_height_m)
        rng = np.random.default_rng(3)
        self._streaks = [_streaks(width, height, rng) for _ in range(STREAK_SHEETS)]
        self._drops = _drops(width, height, rng)
        corner = np.hypot(width, height) / 2
        light = 1 - (1 - CORNER_LIGHT) * ((u**2 + v**2) / corner**2)[..., None]
        self._light = np.repeat(np.round(255 * light), 3, axis=2).astype(np.uint8)
        self._distortion = self._undistorted(u, v) if settings.distortion else None

    def expose(
        self, image: Image, distance: Floats, weather: Weather, sun: Sun, rng: np.random.Generator
    ) -> Image:
        """Apply the weather and the camera to a rendered image.

        image: (h, w, 3). distance: (h, w) metres of depth.
        """
        image = self._wet_ground(image, distance, weather)
        image = self._fog(image, distance, weather)
        image = self._glare(image, weather, sun)
        if weather.rain > 0:
            image = self._rain(image, weather, rng)
        return self._take(image, weather, rng)

    def _take(self, image: Image, weather: Weather, rng: np.random.Generator) -> Image:
        """The camera's effects in the order of the light path: lens, exposure, sensor, file."""
        settings = self._settings
        image = self.distort(image)
        if settings.vignetting:
            image = np.asarray(cv2.multiply(image, self._light, scale=1 / 255), np.uint8)
        gain = 1.0
        if settings.exposure:
            mean = float(image[::4, ::4].mean())
            gain = float(np.clip(np.sqrt(MEAN_GREY / max(mean, 1.0)), *GAINS))
            image = np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)
        if settings.noise:
            image = _grainy(
                image, gain * (GRAIN_NIGHT + (GRAIN_DAY - GRAIN_NIGHT) * weather.daylight), rng
            )
        if settings.jpeg_quality is not None:
            coded = cv2.imencode(
                ".jpg", image[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, settings.jpeg_quality)
            )[1]
            image = np.ascontiguousarray(
                np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)[..., ::-1]
            )
        return image

    @property
    def distorts(self) -> bool:
        return self._distortion is not None

    def distort(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Distort an image, (h, w, 3), or a mask, (h, w), like the lens.

        A mask is sampled without interpolation and is 0 outside.
        """
        if self._distortion is None:
            return image
        mask = image.ndim == 2
        how, border = (
            (cv2.INTER_NEAREST, cv2.BORDER_CONSTANT)
            if mask
            else (cv2.INTER_LINEAR, cv2.BORDER_REPLICATE)
        )
        return np.asarray(cv2.remap(image, *self._distortion, how, borderMode=border), np.uint8)

    def _undistorted(self, u: NDArray[np.float64], v: NDArray[np.float64]) -> tuple[Floats, Floats]:
        """Source of each distorted pixel: Brown's model, inverted by Newton's method.

        It converges from one side of the radius.
        """
        distorted = np.hypot(u, v) / self._focal
        k1, radius = self._settings.distortion, distorted
        for _ in range(20):
            radius = radius - (radius * (1 + k1 * radius**2) - distorted) / (1 + 3 * k1 * radius**2)
        share = radius / distorted
        return (u * share + self._width / 2 - 0.5).astype(np.float32), (
            v * share + self._height / 2 - 0.5
        ).astype(np.float32)

    def _wet_ground(self, image: Image, distance: Floats, weather: Weather) -> Image:
        """Wet ground mirrors what is above the horizon, more so at flat angles.

        Exact only for distant objects.
        """
        if weather.rain <= 0:
            return image
        middle = self._height // 2
        below = distance[middle:]
        ground = np.abs(below * self._fall - self._camera_height) < GROUND_M
        mirror = (WET_MIRROR * min(1.0, weather.rain / 60)) * np.clip(
            1.1 - 2.2 * self._fall, 0.25, 1
        )
        share = np.where(ground, mirror, 0).astype(np.float32)
        kernel = tuple(round(side * self._scale) // 2 * 2 + 1 for side in (3, 11))
        seen = cv2.blur(np.ascontiguousarray(image[:middle][::-1]), kernel)[: self._height - middle]
        image = image.copy()
        image[middle:] = cv2.blendLinear(image[middle:], seen, 1 - share, share)
        return image

    def _fog(self, image: Image, distance: Floats, weather: Weather) -> Image:
        if weather.fog <= 0 and weather.rain <= 0:
            return image  # Any fog or rain adds at least the veil of a visibility of 1500 m.
        metres = distance * self._ray
        clear = cv2.exp(metres * np.float32(-weather.extinction_per_m))
        veil = np.empty_like(image)
        veil[:] = np.clip(255 * weather.grey, 0, 255)
        image = np.asarray(cv2.blendLinear(image, veil, clear, 1 - clear), np.uint8)
        return self._backscatter.add(image, metres, weather) if weather.night else image

    def _glare(self, image: Image, weather: Weather, sun: Sun) -> Image:
        strength, (right, up, back) = (
            230 * weather.sunshine * (GLARE_HIDDEN if sun.hidden else 1.0),
            sun.direction,
        )
        if strength < 1 or back > -0.05:
            return image
        x = int(self._width / 2 - self._focal * right / back)
        y = int(self._height / 2 + self._focal * up / back)
        left, top = self._width - x, self._height - y
        if not (0 <= left <= self._width and 0 <= top <= self._height):
            return image
        glow = self._glow[top : top + self._height, left : left + self._width]
        return np.asarray(cv2.add(image, cv2.convertScaleAbs(glow, alpha=strength)), np.uint8)

    def _rain(self, image: Image, weather: Weather, rng: np.random.Generator) -> Image:
        share = weather.rain / 100
        sheet = self._streaks[rng.integers(STREAK_SHEETS)]
        y, x = (int(side * rng.random()) for side in (self._height, self._width))
        alpha = sheet[y : y + self._height, x : x + self._width] * np.float32(
            share * (0.35 + 0.25 * weather.daylight)
        )
        drops = np.empty_like(image)
        drops[:] = np.clip(255 * (0.7 * weather.grey + 0.2 + 0.1 * weather.daylight), 0, 255)
        image = cv2.blendLinear(image, drops, 1 - alpha, alpha)
        if self._settings.rain_on_lens and weather.rain > DROPS_FROM_RAIN:
            image = self._wet_lens(image, weather)
        if share > 0.3:
            blurred = cv2.GaussianBlur(image, (0, 0), 0.9 * share * self._scale)
            image = cv2.addWeighted(image, 1 - 0.5 * share, blurred, 0.5 * share, 0)
        return image

    def _wet_lens(self, image: Image, weather: Weather) -> Image:
        """Drops show the scene blurred and upside down.

        The drops depend on the weather alone, so they stay in place for an episode.
        """
        level = int((weather.rain - DROPS_FROM_RAIN) / (100.001 - DROPS_FROM_RAIN) * DROP_LEVELS)
        mask = self._drops[level]
        if round(weather.sun_azimuth) % 2:
            mask = np.ascontiguousarray(mask[:, ::-1])
        size = (REFERENCE_WIDTH // 8, max(1, round(self._height / self._scale / 8)))
        small = cv2.blur(cv2.resize(image, size, interpolation=cv2.INTER_AREA), (3, 3))
        seen = cv2.resize(small[::-1], (self._width, self._height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(cv2.blendLinear(image, seen, 1 - mask, mask), np.uint8)


def _grainy(image: Image, deviation: float, rng: np.random.Generator) -> Image:
    """Add independent Gaussian noise to each channel; standard deviation in grey levels."""
    table = np.round(deviation * QUANTILES)
    drawn = (
        rng.integers(0, 2**64, -(-image.size // 8), np.uint64)
        .view(np.uint8)[: image.size]
        .reshape(image.shape)
    )
    lighter, darker = (
        cv2.LUT(drawn, np.maximum(half, 0).astype(np.uint8)) for half in (table, -table)
    )
    return np.asarray(cv2.subtract(cv2.add(image, lighter), darker), np.uint8)


def _drops(width: int, height: int, rng: np.random.Generator) -> list[Floats]:
    """Opacity (h, w) of the drops on the lens for each level of rain.

    Each level includes the drops of the one before.
    """
    masks, mask = [], np.zeros((height, width), np.float32)
    for _ in range(DROP_LEVELS):
        for _ in range(5):
            radius = float(rng.uniform(0.008, 0.022)) * width
            centre = (int(width * rng.random()), int(height * rng.random()))
            axes = (int(radius), int(radius * rng.uniform(1, 1.4)))
            cv2.ellipse(mask, centre, axes, 0, 0, 360, float(rng.uniform(0.45, 0.75)), -1)
        masks.append(np.ascontiguousarray(cv2.GaussianBlur(mask, (0, 0), 0.0035 * width)))
    return masks


def _glow(width: int, height: int) -> Floats:
    """(2h, 2w, 3) glare around its centre, 0 to about 2: disc, halo and a veil over the lens."""
    v, u = np.mgrid[-height:height, -width:width].astype(np.float32)
    r = np.sqrt(u**2 + v**2) / width
    shape = 1.2 * np.exp(-((r / 0.022) ** 2)) + 0.7 * np.exp(-r / 0.09) + 0.22 * np.exp(-r / 0.45)
    return np.asarray(shape[..., None] * np.array([1, 0.95, 0.82]), np.float32)


def _streaks(width: int, height: int, rng: np.random.Generator) -> Floats:
    """(2h, 2w) opacity of falling drops; any window of the image size shows a different shower."""
    w, h = REFERENCE_WIDTH, round(height * REFERENCE_WIDTH / width)
    sheet = np.zeros((2 * h, 2 * w), np.float32)
    for _ in range(w * h // 90):
        x, y, length = rng.integers(2 * w), rng.integers(2 * h), int(rng.integers(h // 26, h // 9))
        steps = np.arange(length)
        opacity = rng.uniform(0.15, 0.6) * np.sin(np.pi * (steps + 0.5) / length)
        sheet[(y + steps) % (2 * h), (x + (0.12 * steps).astype(int)) % (2 * w)] = opacity
    return np.asarray(
        cv2.resize(sheet, (2 * width, 2 * height), interpolation=cv2.INTER_LINEAR), np.float32
    )
