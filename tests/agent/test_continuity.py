"""A drone does not jump when its localisation does."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from one_pilot import MISSION, START_NS, TICK_NS, state
from scipy.spatial.transform import Rotation

from agent.attitude import yaw_of
from agent.continuity import ADDED_M, ADDED_RAD, carried_on
from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform
from agent.ownframe import OwnFrame

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


def test_the_own_frame_goes_on_in_a_new_epoch_until_the_log_knows_better():
    graph = FrameGraph.from_launch_layout(MISSION)
    own = OwnFrame("d1", graph)
    for tick in range(3):
        own.follow(state(START_NS + tick * TICK_NS))
    assert own.locate(0)
    before = own.mission_from_local.apply_point((0.0, 0.0, 3.0))
    jumped = state(START_NS + 3 * TICK_NS, position=(20.0, -5.0, 3.0), epoch=1)
    assert not own.locate(1)
    own.follow(jumped)
    assert own.locate(1)
    assert own.mission_from_local.apply_point(jumped.position_m) == pytest.approx(before)
    assert own.local_from_mission.apply_point(before) == pytest.approx(jumped.position_m)
    assert own.sigma_m(jumped) == pytest.approx(ADDED_M * 2**0.5)
    own.follow(replace(jumped, stamp_ns=START_NS + 4 * TICK_NS, epoch=2, position_m=(0.0, 9.0, 3.0)))
    assert own.locate(2)  # two jumps before the log knows of the first
    assert own.mission_from_local.apply_point((0.0, 9.0, 3.0)) == pytest.approx(before)
    better = Transform(0.1, (1.0, 2.0, 0.0))
    graph.place("d1", 2, better)
    assert own.locate(2)
    assert own.mission_from_local is better
