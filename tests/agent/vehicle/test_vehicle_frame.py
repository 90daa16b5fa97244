"""The autopilot's frames and the agent's describe the same thing: checked against scipy's Rotation."""

from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from radron.agent.vehicle.frame import (
    enu_from_flu,
    enu_from_ned,
    enu_from_ned_position,
    frd_from_flu,
    heading,
    ned_from_enu,
    ned_from_enu_position,
    ned_yaw,
    turned_on,
    up_share,
)
from radron.agent.vehicle.interface import LaunchPlace

LAUNCH = LaunchPlace(
    north_m=10.0, east_m=-20.0, down_m=3.0, origin_latitude_deg=47.0, origin_longitude_deg=8.0, origin_altitude_m=400.0
)
ENU_FROM_NED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]], dtype=float)
FRD_FROM_FLU = np.diag([1.0, -1.0, -1.0])
coordinates = st.tuples(*[st.floats(-1e4, 1e4)] * 3)
angles = st.floats(-pi, pi)


def test_the_launch_place_is_the_origin_and_axes_are_east_north_up() -> None:
    assert enu_from_ned_position((10.0, -20.0, 3.0), LAUNCH) == (0.0, 0.0, 0.0)
    assert enu_from_ned_position((11.0, -18.0, 0.0), LAUNCH) == (2.0, 1.0, 3.0)
    assert enu_from_ned((1.0, 2.0, 3.0)) == (2.0, 1.0, -3.0)


@given(coordinates)
def test_there_and_back(vector: tuple[float, float, float]) -> None:
    assert ned_from_enu(enu_from_ned(vector)) == vector
    assert ned_from_enu_position(enu_from_ned_position(vector, LAUNCH), LAUNCH) == pytest.approx(vector, abs=1e-9)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_the_attitude_turns_body_vectors_as_scipy_does(roll: float, pitch: float, yaw: float) -> None:
    ned_from_frd = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    expected = ENU_FROM_NED @ ned_from_frd.as_matrix() @ FRD_FROM_FLU
    quaternion = enu_from_flu(tuple(ned_from_frd.as_quat(scalar_first=True)))
    np.testing.assert_allclose(Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), expected, atol=1e-9)
    assert up_share(quaternion) == pytest.approx(expected[2, 2], abs=1e-9)


@given(angles, st.floats(-1.5, 1.5), angles, st.tuples(*[st.floats(-2.0, 2.0)] * 3))
def test_a_turning_body_is_carried_on(roll: float, pitch: float, yaw: float, rates_rps: tuple[float, float, float]) -> None:
    before = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    after = turned_on(tuple(before.as_quat(scalar_first=True)), rates_rps, 0.033)
    expected = before * Rotation.from_rotvec(np.array(rates_rps) * 0.033)
    assert (Rotation.from_quat(after, scalar_first=True).inv() * expected).magnitude() < 3e-4


@given(st.floats(-10.0, 10.0))
def test_a_heading_points_the_same_way_in_both_frames(yaw_rad: float) -> None:
    turned = ned_yaw(yaw_rad)
    assert -pi < turned <= pi
    assert (sin(turned), cos(turned)) == pytest.approx((cos(yaw_rad), sin(yaw_rad)), abs=1e-9)


@given(angles, st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.tuples(*[st.floats(-2.0, 2.0)] * 3))
def test_the_heading_and_its_change_are_those_of_the_attitude(
    yaw: float, pitch: float, roll: float, rates: tuple[float, ...]
) -> None:
    x, y, z, w = Rotation.from_euler("ZYX", (yaw, pitch, roll)).as_quat()
    found, turning = heading((w, x, y, z), rates)
    assert sin(found - yaw) == pytest.approx(0.0, abs=1e-6)
    step_s = 1e-6
    later, _ = heading(turned_on((w, x, y, z), rates, step_s), rates)
    assert sin(later - found) / step_s == pytest.approx(turning, abs=1e-3)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_attitudes_go_there_and_back(yaw: float, pitch: float, roll: float) -> None:
    x, y, z, w = Rotation.from_euler("ZYX", (yaw, pitch, roll)).as_quat()
    x2, y2, z2, w2 = (frd := frd_from_flu(enu_from_flu((w, x, y, z))))[1:] + frd[:1]
    assert (Rotation.from_quat((x, y, z, w)).inv() * Rotation.from_quat((x2, y2, z2, w2))).magnitude() < 1e-6
