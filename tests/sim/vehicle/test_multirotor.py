"""The vehicle must respond as a real PX4 did (circle of 12 m at 3 m/s: lag 0.35-0.41 s, radius 0.7-1.1 m too large)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.vehicle.multirotor import GRAVITY_MPS2, Multirotors, MultirotorTruth, attitude

STEP_S = 0.05


def still(position=((0.0, 0.0, 3.0),), **truth):
    truth = MultirotorTruth(gust_mps2=0.0, **truth)
    start = np.array(position)
    return Multirotors(truth, start, np.zeros(len(start)), STEP_S, np.random.default_rng(1))


def circle(time_s, radius=12.0, rate=0.25):
    angle = rate * time_s
    position = np.array([[radius * np.cos(angle), radius * np.sin(angle), 3.0]])
    velocity = radius * rate * np.array([[-np.sin(angle), np.cos(angle), 0.0]])
    return position, velocity


def test_circle_as_measured_on_px4():
    vehicle = still([[12.0, 0.0, 3.0]])
    radii, lags = [], []
    for step in range(2000):
        sent_s = step * STEP_S  # setpoints at 20 Hz
        vehicle.step(*circle(sent_s), np.zeros(1), np.array([False]))
        x, y, _ = vehicle.position_m[0]
        if step > 1000:
            radii.append(np.hypot(x, y))
            behind = 0.25 * (step + 1) * STEP_S - np.arctan2(y, x)
            lags.append((np.remainder(behind + np.pi, 2 * np.pi) - np.pi) / 0.25)
    assert 12.7 < np.mean(radii) < 13.1
    assert 0.35 < np.mean(lags) < 0.42


def test_step_overshoots_and_settles():
    vehicle = still()
    track = []
    for _ in range(400):
        vehicle.step(np.array([[1.0, 0.0, 3.0]]), np.zeros((1, 3)), np.zeros(1), np.array([False]))
        track.append(vehicle.position_m[0, 0])
    assert 1.02 < max(track) < 1.35
    assert track[-1] == pytest.approx(1.0, abs=0.01)


def test_acceleration_is_limited_by_tilt():
    vehicle = still(maximum_acceleration_mps2=3.0)
    for _ in range(20):
        vehicle.step(np.array([[500.0, 500.0, 3.0]]), np.zeros((1, 3)), np.zeros(1), np.array([False]))
        assert np.hypot(*vehicle.acceleration_mps2[0, :2]) <= 3.0 + 1e-9


def test_on_the_ground_nothing_moves():
    vehicle = still([[1.0, 2.0, 0.0]])
    vehicle.step(np.array([[9.0, 9.0, 9.0]]), np.ones((1, 3)), np.ones(1), np.array([True]))
    assert vehicle.position_m[0].tolist() == [1.0, 2.0, 0.0]
    assert vehicle.velocity_mps[0].tolist() == [0.0, 0.0, 0.0]
    assert vehicle.yaw_rad[0] == 0.0


def test_attitude_points_the_thrust():
    w, x, y, z = attitude(0.7, 1.0, 2.0, 0.3)
    rotation = Rotation.from_quat((x, y, z, w))
    thrust = np.array([1.0, 2.0, 0.3 + GRAVITY_MPS2])
    np.testing.assert_allclose(rotation.apply([0, 0, 1]), thrust / np.linalg.norm(thrust), atol=1e-12)
    assert rotation.as_euler("ZYX")[0] == pytest.approx(0.7)


def test_heading_follows_the_shorter_way():
    vehicle = still()
    vehicle.yaw_rad[:] = 3.0
    for _ in range(100):
        vehicle.step(np.array([[0.0, 0.0, 3.0]]), np.zeros((1, 3)), np.array([-3.0]), np.array([False]))
    assert vehicle.yaw_rad[0] == pytest.approx(2 * np.pi - 3.0, abs=0.01)
