"""The source as a camera sees it."""

from __future__ import annotations

import numpy as np
import pytest

from radron.sim.world.frame import CameraMount

LEVEL = (1.0, 0.0, 0.0, 0.0)


def test_the_direction_points_from_camera_to_source() -> None:
    seen = CameraMount((0.0, 0.0, 90.0)).view(np.array([1.0, 2.0, 3.0]), LEVEL, (1.0, 2.0 + 4.0, 3.0), 1e9)
    assert seen.direction == pytest.approx((1.0, 0.0, 0.0))
    assert seen.distance_m == 4.0


@pytest.mark.parametrize("away_m", [0.0, 1e-200])
def test_a_source_at_the_camera_itself_is_seen_from_below(away_m: float) -> None:
    """A source on a launch place."""
    seen = CameraMount((0.0, 0.0, 0.0)).view(np.array([25.0, 2.0, 0.0]), LEVEL, (25.0, 2.0, away_m), 3e9)
    assert seen.direction == (0.0, 0.0, -1.0)
    assert seen.distance_m == 0.0
