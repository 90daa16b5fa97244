"""A drone's frame stays continuous when its localisation jumps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from agent.frames.transform import Transform
from agent.geometry import yaw_of
from agent.localization.continuity import ADDED_M, ADDED_RAD, carried_on

metres = st.floats(-200.0, 200.0)
places = st.tuples(metres, metres, metres)
angles = st.floats(-3.1, 3.1)


def attitude(yaw_rad):
    x, y, z, w = Rotation.from_euler("ZYX", (yaw_rad, 0.1, -0.05)).as_quat().tolist()
    return w, x, y, z


@given(
    yaw=angles, turned=angles, heading=angles, place=st.tuples(metres, metres, metres), moved=st.tuples(metres, metres, metres)
)
def test_place_and_heading_in_the_mission_frame_stay(yaw, turned, heading, place, moved):
    """The same pose told in a frame that has been turned and moved."""
    old = Transform(yaw, (5.0, -3.0, 1.0))
    told = Transform(turned, moved)
    after = told.apply_point(place), attitude(heading + turned)
    new = carried_on(old, (place, attitude(heading)), (0.0, 0.0, 0.0), after, 0.05)
    assert new.apply_point(after[0]) == pytest.approx(old.apply_point(place), abs=1e-8)
    assert math.remainder(new.yaw_rad + heading + turned - yaw - heading, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_it_flies_on_between_the_two_poses():
    new = carried_on(Transform(), ((1.0, 2.0, 3.0), attitude(0.0)), (4.0, 0.0, 0.0), ((50.0, 0.0, 3.0), attitude(0.0)), 0.5)
    assert new.apply_point((50.0, 0.0, 3.0)) == pytest.approx((3.0, 2.0, 3.0))


def test_its_errors_are_those_of_before_at_its_place_and_what_the_jump_adds():
    covariance = np.diag([0.04, 0.09, 0.01, 0.0025])
    old = Transform(0.7, (5.0, -3.0, 1.0), covariance)
    place, after = (30.0, 10.0, 3.0), (-80.0, 60.0, 4.0)
    new = carried_on(old, (place, attitude(0.2)), (0.0, 0.0, 0.0), (after, attitude(1.4)), 0.05)
    position_m, yaw_rad = old.sigmas_at(place)
    found_m, found_rad = new.sigmas_at(after)
    assert found_m == pytest.approx(math.hypot(position_m, ADDED_M * 2**0.5))
    assert found_rad == pytest.approx(math.hypot(yaw_rad, ADDED_RAD))


@given(angles)
def test_the_heading_of_an_attitude(yaw):
    assert math.remainder(yaw_of(attitude(yaw)) - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
