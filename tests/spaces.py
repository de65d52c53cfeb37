"""Scenario spaces that several tests share."""

from __future__ import annotations

from pipeline.core.space import Space, Variable

ANIMATIONS = ("walking", "texting", "crouching", "limping", "drunk", "stumble")
BLUEPRINTS = tuple(f"{kind} {number:02d}" for kind in "WM" for number in range(1, 38))

THESIS = Space(
    (
        Variable("rain", "continuous", "%", 0, 100, 10, mildest=0),
        Variable("fog", "continuous", "%", 0, 100, 10, mildest=0),
        Variable("sun_azimuth", "continuous", "deg", 0, 360, 30, cyclic=True, mildest=180),
        Variable("sun_altitude", "continuous", "deg", -20, 90, 10, mildest=60),
        Variable("pedestrian_shift", "continuous", "m", -0.5, 0.5, 0.1),
        Variable("pedestrian_speed", "continuous", "m/s", 0, 3, 0.25, mildest=0.5),
        Variable("animation", "categorical", values=ANIMATIONS, mildest="walking"),
        Variable("blueprint", "categorical", values=BLUEPRINTS),
    )
)
"""Thesis Table 6.2 with 12 azimuths and 74 blueprints."""

SMALL = Space(
    (
        Variable("x", "continuous", "m", 0, 10, 1),
        Variable("angle", "continuous", "deg", 0, 360, 30, cyclic=True),
        Variable("count", "integer", "", 1, 5, 1),
        Variable("kind", "categorical", values=("a", "b", "c")),
    )
)

CONSTRAINED = Space(SMALL.variables, (("kind != a", "count = 1"), ("x != 10",)))
"""Kind a only with count 1, and without the highest x."""

CUT = Space(
    (
        Variable("fog", "continuous", "%", 0, 100, cuts=(20, 50)),
        Variable("azimuth", "continuous", "deg", 0, 360, cyclic=True, cuts=(45, 135, 225, 315)),
        Variable("lit", "categorical", values=("no", "yes")),
        Variable("speed", "continuous", "m/s", 0, 3, 0.5),
    ),
    (("fog = [0, 20)", "lit = yes"), ("azimuth != [315, 45)", "lit = no")),
)
"""Parts between cuts as categories, one of them across the ends of a circle."""
