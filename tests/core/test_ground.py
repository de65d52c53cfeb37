"""Where the foot of a box lies on the road, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.core.ground import Pinhole

VIEW = Pinhole(320, 192, 240.0, ahead_m=0.5, above_m=1.5)


def test_a_box_stands_where_the_ray_through_its_foot_meets_the_road() -> None:
    """36 pixels below the horizon are 10 m ahead of the camera.

    There, 40 pixels beside the middle of the image are 5/3 m.
    """
    right, left = (196, 80, 204, 132), (116, 80, 124, 132)
    assert VIEW.ground([right, left]) == pytest.approx(np.array([[10.5, -5 / 3], [10.5, 5 / 3]]))


@pytest.mark.parametrize("bottom", [96, 60])
def test_a_box_that_ends_at_or_above_the_horizon_stands_nowhere(bottom: int) -> None:
    assert np.isinf(VIEW.ground([(0, 0, 10, bottom)])).all()
