import math
from itertools import pairwise

import numpy as np
import pytest

from radron.agent.config.mission import GroundConfig
from radron.agent.frames.transform import Transform
from radron.agent.fusion.observation import ConeObservation, ConeSurface
from radron.agent.terrain.ground import Ground
from radron.protocol.entries import EntryId
from radron.station.picture.curves import DETAIL_M, ground_curves

GROUND = Ground(GroundConfig())


def cone(axis, theta_deg, apex=(1.0, 2.0, 10.0)):
    axis = tuple(np.array(axis) / np.linalg.norm(axis))
    surface = ConeSurface(0, apex, axis, math.radians(theta_deg), 0.05, 1.0)
    return ConeObservation(0, (surface,), 0.1, 0.01, Transform(), EntryId("m", 0, "d1", "b", 1), 0)


def test_a_cone_straight_down_meets_level_ground_in_a_circle():
    (circle,) = ground_curves(cone((0.0, 0.0, -1.0), 30.0), GROUND)
    radii = [math.hypot(x - 1.0, y - 2.0) for x, y in circle]
    assert radii == pytest.approx([10.0 * math.tan(math.radians(30.0))] * len(circle), abs=0.01)
    assert circle[0] == pytest.approx(circle[-1], abs=0.011)  # closed


@pytest.mark.parametrize(("axis", "theta_deg"), [((1.0, 0.0, 0.0), 40.0), ((0.3, 0.8, -0.4), 70.0), ((0.0, 1.0, 0.2), 110.0)])
def test_every_point_lies_at_the_cones_angle_from_its_axis_and_within_reach(axis, theta_deg):
    given = cone(axis, theta_deg)
    curves = ground_curves(given, GROUND, reach_m=60.0)
    assert curves
    for x, y in (point for curve in curves for point in curve):
        ray = np.array([x, y, 0.0]) - given.apex
        cosine = ray @ given.readings[0].axis / np.linalg.norm(ray)
        assert math.degrees(math.acos(cosine)) == pytest.approx(theta_deg, abs=0.1)
        assert math.hypot(ray[0], ray[1]) < 60.1


def test_a_curve_has_few_points_and_keeps_close_to_the_cone():
    given = cone((0.0, 0.0, -1.0), 45.0)
    (circle,) = ground_curves(given, GROUND)
    assert 8 <= len(circle) <= 36  # of 73
    middles = [((x + u) / 2.0, (y + v) / 2.0) for (x, y), (u, v) in pairwise(circle)]
    assert all(math.hypot(x - 1.0, y - 2.0) == pytest.approx(10.0, abs=1.5 * DETAIL_M) for x, y in middles)


def test_a_cone_into_the_sky_meets_no_ground():
    assert ground_curves(cone((0.0, 0.0, 1.0), 30.0), GROUND) == ()


def test_the_height_of_the_ground_counts():
    hill = Ground(GroundConfig(height_m=4.0))
    (circle,) = ground_curves(cone((0.0, 0.0, -1.0), 45.0), hill)
    assert math.hypot(circle[0][0] - 1.0, circle[0][1] - 2.0) == pytest.approx(6.0, abs=0.01)
