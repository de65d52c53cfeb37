"""Other road users move as their scenario says."""

from __future__ import annotations

from pipeline.scenarios.functional import Actor


def test_a_road_user_waits_until_it_starts() -> None:
    actor = Actor(kind="van", x_m=0, y_m=0, speed_kmh=36, starts_s=2)
    assert [actor.travelled(time_s) for time_s in (0, 2, 3.5)] == [0, 0, 15]
