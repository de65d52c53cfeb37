"""Sun, sky, lamps and wet roads: the model in a weather and at a time of day, before rendering."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.core.visibility import visual_range_m
from pipeline.simulators.mujoco.textures import noise

Floats = NDArray[np.float64]
LAMPS_ON_BELOW_DEG = 0.0
SUN_DEG, OUTDOORS_LX = (-12.0, -6.0, 0.0, 10.0), (0.008, 3.4, 400.0, 13700.0)
"""Illuminance of the ground under a clear sky at altitudes of the sun: the twilights' limits from
the Glossary of Meteorology (American Meteorological Society), 10 degrees from Haurwitz' clear-sky
irradiance at 100 lm/W."""
LAMPS_LX = 30.0
"""Illuminance that headlights and street lamps give the road ahead."""
EXPOSURE_POWER = 0.12
"""Grey levels rise with this power of the illuminance: the camera's exposure reduces six decades of
light to a range of 1 to 6."""
RANGE_CONTRAST = 0.05
"""Contrast left at the visual range (Koschmieder, as the meteorological optical range is
defined)."""
SKY_SIZE = 128


def mix(a: ArrayLike, b: ArrayLike, share: float) -> Floats:
    """Linear interpolation, share 0 is `a`."""
    return np.asarray(a, float) * (1 - share) + np.asarray(b, float) * share


@dataclass(frozen=True)
class Weather:
    """Weather and time of day.

    rain, fog: %, 0 to 100. sun_azimuth: degrees in the world frame, 0 along x, 90 to the left.
    sun_altitude: degrees. clouds: %, 0 to 100, of a dry sky; rain and fog add their own.
    """

    rain: float = 0.0
    fog: float = 0.0
    sun_azimuth: float = 90.0
    sun_altitude: float = 60.0
    clouds: float = 0.0

    @property
    def night(self) -> bool:
        """Whether street lamps and headlights are on.

        Everything that depends on them uses this condition.
        """
        return self.sun_altitude < LAMPS_ON_BELOW_DEG

    @property
    def daylight(self) -> float:
        """0 once nautical twilight has ended, at -12 degrees.

        1 with the sun at 10 degrees or higher.
        """
        dark, full = _exposed(OUTDOORS_LX[0]), _exposed(OUTDOORS_LX[-1])
        return (_exposed(self._outdoors_lx) - dark) / (full - dark)

    @property
    def lamplight(self) -> float:
        """Share of the lamps' light that shows: 0 by day and just after sunset, 1 at night."""
        if not self.night:
            return 0.0
        outdoors, dark = self._outdoors_lx, OUTDOORS_LX[0]
        return (_exposed(outdoors + LAMPS_LX) - _exposed(outdoors)) / (
            _exposed(dark + LAMPS_LX) - _exposed(dark)
        )

    @property
    def _outdoors_lx(self) -> float:
        return float(10 ** np.interp(self.sun_altitude, SUN_DEG, np.log10(OUTDOORS_LX)))

    @property
    def overcast(self) -> float:
        """How much of the sky is grey, 0 to 0.95."""
        return max(
            0.9 * min(1.0, self.rain / 60), 0.95 * min(1.0, self.fog / 60), 0.9 * self.clouds / 100
        )

    @property
    def sunshine(self) -> float:
        """Direct sunlight, 0 to 1."""
        return float(np.clip((self.sun_altitude + 0.5) / 11, 0, 1)) * (1 - self.overcast)

    @property
    def sun_direction(self) -> Floats:
        """(3,) unit vector towards the sun, world frame."""
        altitude, azimuth = np.radians(self.sun_altitude), np.radians(self.sun_azimuth)
        return np.array(
            [
                np.cos(altitude) * np.cos(azimuth),
                np.cos(altitude) * np.sin(azimuth),
                np.sin(altitude),
            ]
        )

    @property
    def extinction_per_m(self) -> float:
        """Extinction coefficient of fog and rain: `RANGE_CONTRAST` is left at the visual range."""
        return float(-np.log(RANGE_CONTRAST) / visual_range_m(self.fog) + 0.008 * self.rain / 100)

    @property
    def grey(self) -> Floats:
        """(3,) colour of fog and overcast sky, 0 to 1."""
        return mix([0.05, 0.05, 0.058], [0.68, 0.7, 0.72], self.daylight)

    @property
    def sky(self) -> tuple[Floats, Floats]:
        """Colours at the horizon and at the zenith, (3,) each, 0 to 1."""
        warm = float(np.clip(1 - abs(self.sun_altitude - 2) / 18, 0, 1))
        horizon = mix(
            [0.035, 0.04, 0.07],
            mix([0.74, 0.83, 0.93], [0.96, 0.64, 0.4], 0.65 * warm),
            self.daylight,
        )
        zenith = mix([0.01, 0.012, 0.035], [0.27, 0.46, 0.8], self.daylight)
        return mix(horizon, self.grey, self.overcast), mix(zenith, 0.94 * self.grey, self.overcast)


def _exposed(illuminance_lx: float) -> float:
    """Brightness in the image, up to a factor, of what has this illuminance."""
    return float(illuminance_lx**EXPOSURE_POWER)


class WeatherControl:
    """Applies a weather to a compiled model.

    Sets everything each time, so that no episode affects the next.
    """

    def __init__(self, model: mujoco.MjModel, lamps: Floats) -> None:
        self._model, self._lamps = model, lamps
        self._sun = model.light("sun").id
        self._street = [i for i in range(model.nlight) if model.light(i).name.startswith("street")]
        self._heads = [model.light("head_left").id, model.light("head_right").id]
        self._lamplight = {
            name: np.array(getattr(model, name))
            for name in ("light_diffuse", "light_specular", "light_attenuation")
        }
        rng = np.random.default_rng(5)
        self._clouds = noise((SKY_SIZE, SKY_SIZE), rng, octaves=4)
        self._texture = int(np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)[0])

    def apply(self, weather: Weather, context: mujoco.MjrContext) -> None:
        """Set lights, materials and sky."""
        model, sun = self._model, weather.sunshine
        warm = float(np.clip(1 - weather.sun_altitude / 30, 0, 1))
        model.light_active[self._sun] = sun > 0.02
        model.light_dir[self._sun] = -weather.sun_direction
        model.light_diffuse[self._sun] = mix([1.0, 0.96, 0.88], [1.0, 0.66, 0.4], warm) * sun * 0.95
        model.light_specular[self._sun] = 0.4 * model.light_diffuse[self._sun]
        clear = mix([0.05, 0.055, 0.085], [0.4, 0.43, 0.48], weather.daylight)
        dull = mix([0.055, 0.055, 0.065], [0.62, 0.63, 0.65], weather.daylight)
        model.vis.headlight.ambient[:] = mix(clear, dull, weather.overcast)
        self._light_lamps(weather)
        for name, emission in (("street_lamp", 1.0), ("lamp_front", 0.9), ("lamp_rear", 0.8)):
            model.mat_emission[model.material(name).id] = emission if weather.night else 0.0
        pane = model.material("window_light").id
        model.mat_emission[pane] = 0.9 if weather.daylight < 0.6 else 0.0
        model.mat_rgba[pane, :3] = (
            (0.95, 0.78, 0.45) if weather.daylight < 0.6 else (0.24, 0.29, 0.33)
        )
        self._wet_road(weather)
        self._paint_sky(weather, context)

    def _light_lamps(self, weather: Weather) -> None:
        """Fog and rain dim the lamps' light: an exponential, to the second order of OpenGL."""
        model, lamps, extinction = self._model, self._street + self._heads, weather.extinction_per_m
        model.light_active[lamps] = weather.night
        for name in ("light_diffuse", "light_specular"):
            getattr(model, name)[lamps] = self._lamplight[name][lamps] * weather.lamplight
        model.light_attenuation[lamps] = self._lamplight["light_attenuation"][lamps] + (
            0,
            extinction,
            extinction**2 / 2,
        )

    def _wet_road(self, weather: Weather) -> None:
        model, wet = self._model, min(1.0, weather.rain / 50)
        for name in ("road", "pavement"):
            model.mat_rgba[model.material(name).id, :3] = 1 - 0.4 * wet
        road = model.material("road").id
        model.mat_specular[road], model.mat_shininess[road] = 0.1 + 0.6 * wet, 0.3 + 0.4 * wet

    def follow(self, place: Floats, ahead: Floats, weather: Weather) -> None:
        """Move the sun's shadow box and the few lights that MuJoCo allows with the ego.

        Place, ahead: (2,) metres.
        """
        model = self._model
        model.light_pos[self._sun] = (
            np.array([*(place + 20 * ahead), 0]) + 45 * weather.sun_direction
        )
        nearest = np.argsort(np.hypot(*(self._lamps[:, :2] - place - 14 * ahead).T), kind="stable")[
            : len(self._street)
        ]
        model.light_pos[self._street] = self._lamps[nearest]

    def _paint_sky(self, weather: Weather, context: mujoco.MjrContext) -> None:
        model, size = self._model, SKY_SIZE
        horizon, zenith = weather.sky
        ramp = (np.arange(size) + 0.5) / size * 2 - 1
        ray = np.sqrt(1 + ramp[:, None] ** 2 + ramp[None] ** 2)
        side, up = np.clip(-ramp[:, None] / ray, 0, 1), 1 / ray
        address = model.tex_adr[self._texture]
        faces = model.tex_data[address : address + 6 * size * size * 3].reshape(6, size, size, 3)
        cloudiness = 0.5 * weather.daylight * (1 - weather.overcast)
        cloud = np.clip(self._clouds - 0.4, 0, 1)[..., None]
        for face, elevation in (
            (0, side),
            (1, side),
            (2, up),
            (3, np.zeros_like(up)),
            (4, side),
            (5, side),
        ):
            colour = horizon + np.clip(elevation, 0, 1)[..., None] ** 0.6 * (zenith - horizon)
            cover = cloudiness * cloud * np.clip(4 * elevation, 0, 1)[..., None]
            faces[face] = np.clip(255 * (colour * (1 - cover) + cover * 0.97), 0, 255)
        mujoco.mjr_uploadTexture(model, context, self._texture)
