import math

import msgspec
import numpy as np
import pytest

from radron.agent.frames.transform import Transform
from radron.agent.fusion.observation import observe
from radron.protocol.entries import ConeOrder, PoseSample


@pytest.fixture
def cone(kit):
    return kit.cone_entry(kit.mission_of(), 1.0, (1.0, 0.0, 3.0), (1.0, 0.0, 0.0), 0.7)


def with_orders(cone, *orders):
    return msgspec.structs.replace(cone, orders=tuple(ConeOrder(axis, theta, 0.1, p) for axis, theta, p in orders))


def test_a_cone_moves_into_the_mission_frame(cone):
    seen = observe(cone, Transform(math.pi / 2, (10.0, 20.0, 1.0)))
    assert (seen.stamp_ns, seen.identity, seen.epoch) == (cone.stamp_ns, cone.entry_id, cone.epoch)
    for reading in seen.readings:
        assert reading.apex == pytest.approx((10.0, 21.0, 4.0))
    assert seen.readings[0].axis == pytest.approx((0.0, 1.0, 0.0))
    assert (seen.readings[0].stamp_ns, seen.readings[0].theta_rad, seen.readings[0].sigma_rad) == (cone.stamp_ns, 0.7, 0.1)


@pytest.mark.parametrize(("probabilities", "theta"), [((0.2, 0.8), 2.0), ((0.8, 0.2), 1.0), ((0.5, 0.5), 1.0)])
def test_the_more_probable_reading_and_the_first_of_equals(cone, probabilities, theta):
    up, down = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
    both = with_orders(cone, (up, 1.0, probabilities[0]), (down, 2.0, probabilities[1]))
    assert observe(both, Transform()).probable.theta_rad == theta


@pytest.mark.parametrize(("first", "second"), [(1.0, 2.0), (2.0, 1.0)])
def test_the_forward_reading_is_the_one_with_the_smaller_angle(cone, first, second):
    both = with_orders(cone, ((0.0, 0.0, 1.0), first, 0.1), ((0.0, 0.0, -1.0), second, 0.9))
    assert observe(both, Transform()).forward.theta_rad == 1.0


def test_an_impossible_reading_is_left_out(cone):
    both = with_orders(cone, ((0.0, 0.0, 1.0), 1.0, 0.0), ((0.0, 0.0, -1.0), 2.0, 1.0))
    assert observe(both, Transform()).forward.theta_rad == 2.0


def test_a_sloppy_unit_vector_is_made_one(cone):
    seen = observe(with_orders(cone, ((0.9, 0.0, 0.3), 1.0, 0.6), ((0.0, 0.0, 1.0), 1.0, 0.4)), Transform(1.0))
    assert math.hypot(*seen.probable.axis) == pytest.approx(1.0, abs=1e-12)


def test_impossible_orders_or_no_axis_say_nothing(cone):
    up = (0.0, 0.0, 1.0)
    assert observe(with_orders(cone, (up, 1.0, 0.0), (up, 1.0, 0.0)), Transform()) is None
    assert observe(with_orders(cone, ((0.0, 0.0, 0.0), 1.0, 0.9), (up, 1.0, 0.0)), Transform()) is None


def test_an_exposure_counts_from_the_place_in_its_middle(kit):
    exposure = kit.exposure_entry(kit.mission_of(), 0.0, (1.0, 0.0, 3.0), duration_s=0.4)
    seen = observe(exposure, Transform(math.pi / 2, (10.0, 20.0, 1.0)))
    assert (seen.middle_ns, seen.stamp_ns) == (exposure.stamp_ns + 200_000_000, exposure.end_ns)
    assert seen.position == pytest.approx((10.0, 21.0, 4.0))
    assert (seen.live_time_s, seen.counts.tolist()) == (0.4, [5.0, 0.0, 1.0])


def test_an_exposure_without_live_time_says_nothing(kit):
    exposure = kit.exposure_entry(kit.mission_of(), 0.0, (0.0, 0.0, 3.0))
    assert observe(msgspec.structs.replace(exposure, live_time_s=0.0), Transform()) is None


def test_the_place_in_the_middle_lies_between_the_samples_around_it(kit):
    exposure = kit.exposure_entry(kit.mission_of(), 0.0, (1.0, 0.0, 3.0), duration_s=0.5)
    poses = tuple(PoseSample(round(k * 1e8), (1.0 + k, 0.0, 3.0), (1.0, 0.0, 0.0, 0.0)) for k in range(6))
    seen = observe(msgspec.structs.replace(exposure, poses=poses), Transform())
    assert seen.position == pytest.approx((3.5, 0.0, 3.0))
    only = observe(msgspec.structs.replace(exposure, poses=poses[:1]), Transform())
    assert only.position == (1.0, 0.0, 3.0)
    early = observe(msgspec.structs.replace(exposure, poses=poses[:2]), Transform())
    assert early.position == (2.0, 0.0, 3.0)  # nothing later is known


def test_the_errors_of_an_estimated_frame_count_instead_of_what_the_drone_tells(cone, kit):
    exact = observe(cone, Transform(0.3))
    assert (exact.position_sigma_m, exact.yaw_sigma_rad) == (cone.apex_sigma_m, cone.yaw_sigma_rad)
    covariance = np.diag([0.09, 0.16, 4.0, 0.01])
    far = msgspec.structs.replace(cone, apex_m=(30.0, 40.0, 3.0))
    seen = observe(far, Transform(0.3, (5.0, 0.0, 0.0), covariance))
    assert seen.position_sigma_m == pytest.approx(math.sqrt(0.25 + (50.0 * 0.1) ** 2))  # the heading's error turns distant places
    assert seen.yaw_sigma_rad == pytest.approx(0.1)
    late = observe(msgspec.structs.replace(far, clock_sigma_m=2.0), Transform(0.3, (5.0, 0.0, 0.0), covariance))
    assert late.position_sigma_m == pytest.approx(math.hypot(seen.position_sigma_m, 2.0))
    exposure = kit.exposure_entry(kit.mission_of(), 0.0, (30.0, 40.0, 3.0))
    assert observe(exposure, Transform(0.3, (5.0, 0.0, 0.0), covariance)).position_sigma_m == pytest.approx(seen.position_sigma_m)


def test_the_heading_of_an_exposure_is_that_of_the_mission_frame(kit):
    """Twice the angle: a flat sensor counts the same from in front and from behind."""
    exposure = kit.exposure_entry(kit.mission_of(), 0.0, (1.0, 0.0, 3.0))
    turned = (math.cos(0.4), 0.0, 0.0, math.sin(0.4))  # by 0.8 rad
    poses = tuple(msgspec.structs.replace(pose, quaternion=turned) for pose in exposure.poses)
    for half_turns in (0.0, math.pi):
        seen = observe(msgspec.structs.replace(exposure, poses=poses), Transform(0.3 + half_turns, (5.0, 0.0, 0.0)))
        assert seen.facing == pytest.approx((math.cos(2.2), math.sin(2.2)))


def test_an_exposure_tells_how_far_the_camera_flew_meanwhile(kit):
    exposure = kit.exposure_entry(kit.mission_of(), 0.0, (1.0, 0.0, 3.0))
    poses = tuple(PoseSample(k * 100_000_000, (1.0 + 3.0 * k, 4.0 * k, 3.0), (1.0, 0.0, 0.0, 0.0)) for k in range(3))
    assert observe(msgspec.structs.replace(exposure, poses=poses), Transform(1.0)).way_m == pytest.approx(10.0)
    assert observe(msgspec.structs.replace(exposure, poses=poses[:1]), Transform()).way_m == 0.0
