"""A drone's frame stays continuous when its localisation jumps, and states how sure that is."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from radron.agent.frames.transform import Transform
from radron.agent.geometry import yaw_of
from radron.agent.localization.continuity import POSES_M, POSES_RAD, carried_on
from support.flights.one_pilot import SECOND, START_NS, state

metres = st.floats(-200.0, 200.0)
angles = st.floats(-3.1, 3.1)
UNSURE = np.diag([0.04, 0.09, 0.01, 0.0025])


def pose(position=(0.0, 0.0, 3.0), yaw_rad=0.0, velocity=(0.0, 0.0, 0.0), after_s=0.0, **values):
    stamp_ns = START_NS + round(after_s * SECOND)
    return state(stamp_ns, position=position, quaternion=attitude(yaw_rad), velocity_mps=velocity, **values)


def attitude(yaw_rad):
    x, y, z, w = Rotation.from_euler("ZYX", (yaw_rad, 0.1, -0.05)).as_quat().tolist()
    return w, x, y, z


@given(
    yaw=angles, turned=angles, heading=angles, place=st.tuples(metres, metres, metres), moved=st.tuples(metres, metres, metres)
)
def test_place_and_heading_in_the_mission_frame_stay(yaw, turned, heading, place, moved):
    """The same pose in a frame that has been turned and moved."""
    old = Transform(yaw, (5.0, -3.0, 1.0))
    there = Transform(turned, moved).apply_point(place)
    new = carried_on(old, pose(place, heading), pose(there, heading + turned, after_s=0.05))
    assert new.apply_point(there) == pytest.approx(old.apply_point(place), abs=1e-8)
    assert math.remainder(new.yaw_rad + heading + turned - yaw - heading, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_it_flies_on_and_turns_on_between_the_two_poses():
    new = carried_on(Transform(), pose((1.0, 2.0, 3.0), velocity=(4.0, 0.0, 0.0)), pose((50.0, 0.0, 3.0), after_s=0.5), 0.6)
    assert new.apply_point((50.0, 0.0, 3.0)) == pytest.approx((3.0, 2.0, 3.0))
    assert new.yaw_rad == pytest.approx(0.3)


def test_its_errors_are_those_of_before_at_its_place_and_what_the_jump_adds():
    old = Transform(0.7, (5.0, -3.0, 1.0), UNSURE)
    place, there = (30.0, 10.0, 3.0), (-80.0, 60.0, 4.0)
    new = carried_on(old, pose(place, 0.2), pose(there, 1.4), 0.0)
    position_m, yaw_rad = old.sigmas_at(place)
    found_m, found_rad = new.sigmas_at(there)
    assert found_m == pytest.approx(math.hypot(position_m, POSES_M * 2**0.5))
    assert found_rad == pytest.approx(math.hypot(yaw_rad, POSES_RAD))


def test_where_the_frame_was_known_exactly_the_errors_of_the_localisation_in_it_count():
    told = {"position_sigma_m": 2.0, "yaw_sigma_rad": 0.2}
    found_m, found_rad = carried_on(Transform(), pose(**told), pose(), 0.0).sigmas_at((0.0, 0.0, 3.0))
    assert found_m == pytest.approx(math.hypot(2.0, POSES_M * 2**0.5))
    assert found_rad == pytest.approx(math.hypot(0.2, POSES_RAD))


@pytest.mark.parametrize(
    ("speed_mps", "turning_rps", "gap_s"), [(0.0, 0.0, 2.0), (8.0, 0.0, 0.2), (8.0, 0.0, 2.0), (0.0, None, 2.0)]
)
def test_the_longer_it_takes_and_the_faster_it_flies_the_less_sure_it_is(speed_mps, turning_rps, gap_s):
    velocity, there = (speed_mps, 0.0, 0.0), (9.0, 9.0, 3.0)
    sure = carried_on(Transform(), pose(), pose(there, after_s=0.05), 0.0).sigmas_at(there)
    unsure = carried_on(Transform(), pose(velocity=velocity), pose(there, after_s=gap_s), turning_rps).sigmas_at(there)
    assert unsure[0] > 1.01 * sure[0]
    assert unsure[1] > 1.05 * sure[1]


@given(acceleration=st.floats(-4.0, 4.0), turning=st.floats(-1.0, 1.0), faster=st.floats(-3.0, 3.0), gap_s=st.floats(0.05, 3.0))
def test_what_a_vehicle_can_do_meanwhile_lies_within_its_three_sigmas(acceleration, turning, faster, gap_s):
    """A vehicle of 8 m/s that brakes or turns as hard as it can. The localisation itself is exact, and jumps by (20, -5) m."""
    told = {"position_sigma_m": 0.0, "yaw_sigma_rad": 0.0}
    x, yaw_rad = 8.0 * gap_s + 0.5 * acceleration * gap_s**2, turning * gap_s + 0.5 * faster * gap_s**2
    there = (x + 20.0, -5.0, 3.0)
    before, after = pose(velocity=(8.0, 0.0, 0.0), **told), pose(there, yaw_rad, after_s=gap_s, **told)
    new = carried_on(Transform(), before, after, turning)
    sigma_m, sigma_rad = new.sigmas_at(there)
    assert math.hypot(new.apply_point(there)[0] - x, new.apply_point(there)[1]) < 3.0 * sigma_m
    assert abs(new.yaw_rad) < 3.0 * sigma_rad


@given(angles)
def test_the_heading_of_an_attitude(yaw):
    assert math.remainder(yaw_of(attitude(yaw)) - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_a_clock_that_was_set_back_makes_no_gap():
    new = carried_on(Transform(), pose(velocity=(8.0, 0.0, 0.0), after_s=0.05), pose((3.0, 0.0, 3.0)))
    assert new.apply_point((3.0, 0.0, 3.0)) == pytest.approx((0.0, 0.0, 3.0))


def test_a_vehicle_that_is_not_heard_for_long_has_not_gone_straight_on():
    """A vehicle with its agent lost stops, about 1.5 s of its velocity ahead; expected 9 m further on, it was flown into."""
    before, after = pose((1.0, 2.0, 3.0), velocity=(1.0, 0.0, 0.0)), pose((50.0, 0.0, 3.0), after_s=9.0)
    found = carried_on(Transform(), before, after)
    assert found.apply_point((50.0, 0.0, 3.0)) == pytest.approx((2.5, 2.0, 3.0))
    assert found.sigmas_at((50.0, 0.0, 3.0))[0] > 9.0
