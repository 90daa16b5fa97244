"""The vehicle must respond like a real PX4; ``tests/contract`` compares it with recordings."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from radron.agent.errors import ConfigError
from radron.sim.vehicle.multirotor import GRAVITY_MPS2, Multirotors, MultirotorTruth, Setpoints, attitude

STEP_S = 0.05
NOWHERE = np.zeros((1, 3))
FLYING = np.array([False])


def still(position=((0.0, 0.0, 3.0),), step_s=STEP_S, **truth):
    truth = MultirotorTruth(gust_mps2=0.0, **truth)
    start = np.array(position)
    return Multirotors(truth, start, np.zeros(len(start)), step_s, np.random.default_rng(1))


def asked(position=(0.0, 0.0, 3.0), velocity=(0.0, 0.0, 0.0), acceleration=(0.0, 0.0, 0.0), yaw=0.0, yaw_rate=0.0):
    vectors = (np.array([vector], dtype=float) for vector in (position, velocity, acceleration))
    return Setpoints(*vectors, np.array([yaw]), np.array([yaw_rate]))


def fly(vehicle, seconds, step_s=STEP_S, grounded=FLYING, errors=(NOWHERE, NOWHERE), unsteered=None, **setpoint):
    """Positions (T, 3) on the way to a constant setpoint."""
    track = []
    for _ in range(round(seconds / step_s)):
        vehicle.step(asked(**setpoint), grounded, *errors, unsteered)
        track.append(vehicle.position_m[0].copy())
    return np.array(track)


def circle(time_s, radius, speed, acceleration):
    rate = speed / radius
    out = np.array([np.cos(rate * time_s), np.sin(rate * time_s), 0.0])
    along = np.array([-out[1], out[0], 0.0])
    return asked(radius * out + (0.0, 0.0, 3.0), speed * along, -speed * rate * out * acceleration)


def lag_and_radius_error(vehicle, step_s, radius=12.0, speed=3.0, acceleration=True, unsteered=None):
    """Setpoints at 20 Hz; the third lap."""
    rate, radii, lags = speed / radius, [], []
    steps_of_lap = 2.0 * np.pi / rate / step_s
    for step in range(round(3 * steps_of_lap)):
        if step % round(0.05 / step_s) == 0:
            setpoint = circle(step * step_s, radius, speed, acceleration)
        vehicle.step(setpoint, FLYING, NOWHERE, NOWHERE, unsteered)
        if step > 2 * steps_of_lap:
            x, y, _ = vehicle.position_m[0]
            radii.append(np.hypot(x, y) - radius)
            behind = rate * (step + 1) * step_s - np.arctan2(y, x)
            lags.append((np.remainder(behind + np.pi, 2 * np.pi) - np.pi) / rate)
    return np.mean(lags), np.mean(radii)


@pytest.mark.parametrize("step_s", [0.01, 0.05])
@pytest.mark.parametrize(
    ("drag", "acceleration", "lag_s", "radius_m"), [(1.0, False, 0.40, 1.07), (1.0, True, 0.41, 0.54), (0.3, True, 0.065, 0.05)]
)
def test_circle_as_measured_on_px4(step_s, drag, acceleration, lag_s, radius_m):
    """Means of 4, 7 and 2 runs (the last by estimate and truth)."""
    vehicle = still([[12.0, 0.0, 3.0]], step_s, drag_ps=drag)
    lag, wider = lag_and_radius_error(vehicle, step_s, acceleration=acceleration)
    assert lag == pytest.approx(lag_s, abs=0.1)
    assert wider == pytest.approx(radius_m, abs=0.3)


def test_without_a_position_to_keep_a_circle_is_too_small():
    """Measured: 2.6 m. The velocity falls short until the integrator has made up for the drag."""
    unsteered = np.array([[True, True, False]])
    _, wider = lag_and_radius_error(still([[12.0, 0.0, 3.0]]), STEP_S, acceleration=False, unsteered=unsteered)
    assert wider == pytest.approx(-2.6, abs=0.2)


@pytest.mark.parametrize("step_s", [0.01, 0.05])
@pytest.mark.parametrize("far_m", [1.0, 10.0, 30.0])
def test_follows_the_equations_with_their_limits(step_s, far_m):
    """Solved otherwise; a jump of 10 m meets the highest tilt, one of 30 m the highest speed, too."""
    kp, kv, ki, kd, wn, drag, low_pass = 0.95, 1.8, 0.4, 0.2, 4.2, 1.0, 10.0 * np.pi
    most = GRAVITY_MPS2

    def motion(time_s, state):
        p, v, a, i, filtered = state
        v_s = np.clip(kp * (far_m * (time_s > 0.03) - p), -12.0, 12.0)
        wanted = kv * (v_s - v) + i - kd * low_pass * (v - filtered)
        given = np.clip(wanted, -most, most)
        return [v, a - drag * v, wn * (given - a), ki * (v_s - v - 2.0 / kv * (wanted - given)), low_pass * (v - filtered)]

    times = np.arange(1, round(8.0 / step_s) + 1) * step_s
    expected = solve_ivp(motion, (0.0, times[-1]), np.zeros(5), t_eval=times, max_step=0.002).y[0]
    vehicle = still(step_s=step_s)
    fly(vehicle, 0.05, step_s)  # the setpoint before, which the delay leaves in force
    track = fly(vehicle, 8.0, step_s, position=(far_m, 0.0, 3.0))
    np.testing.assert_allclose(track[:, 0], expected, atol=0.002 * far_m)


def test_step_overshoots_and_settles():
    """Measured: 0.07-0.09 m after 1 m; the rest of it dies away with the integrator."""
    track = fly(still(), 30.0, position=(1.0, 0.0, 3.0))[:, 0]
    assert 1.02 < max(track) < 1.2
    assert track[-1] == pytest.approx(1.0, abs=0.01)


def test_tilt_and_speeds_are_limited():
    vehicle = still(maximum_tilt_deg=20.0, maximum_speed_mps=8.0)
    for _ in range(200):
        vehicle.step(asked((500.0, 500.0, 303.0), (9.0, 0.0, 0.0)), FLYING, NOWHERE, NOWHERE)
        assert np.hypot(*vehicle.thrust_mps2[0, :2]) <= GRAVITY_MPS2 * np.tan(np.deg2rad(20.0)) + 1e-9
    # The drag is found by the integrator, which stops where the tilt does.
    assert np.hypot(*vehicle.velocity_mps[0, :2]) <= GRAVITY_MPS2 * np.tan(np.deg2rad(20.0))
    assert vehicle.velocity_mps[0, 2] == pytest.approx(3.0, abs=0.1)
    fly(vehicle, 10.0, position=(500.0, 500.0, -500.0))
    assert vehicle.velocity_mps[0, 2] == pytest.approx(-1.5, abs=0.1)


def test_the_way_to_the_position_comes_before_the_speed_along():
    """PX4 cuts the velocity's feed-forward first."""
    vehicle = still(maximum_speed_mps=5.0, drag_ps=0.0)
    fly(vehicle, 20.0, position=(4000.0, 0.0, 3.0), velocity=(0.0, 4.0, 0.0))
    assert vehicle.velocity_mps[0, :2] == pytest.approx([5.0, 0.0], abs=0.1)


def test_what_it_steers_is_its_estimate():
    place, speed = np.array([[1.0, 0.0, 0.5]]), np.array([[0.0, 0.3, 0.0]])
    vehicle = still()
    fly(vehicle, 60.0, errors=(place, speed))
    # The vehicle's velocity estimate points north, and the vehicle flies south until the position's error balances the two.
    assert vehicle.position_m[0] == pytest.approx([-1.0, -0.3 / 0.95, 2.5], abs=0.01)


def test_attitude_shows_the_thrust_that_balances_drag():
    vehicle = still(drag_ps=0.5)
    for step in range(800):
        vehicle.step(asked((4.0 * step * STEP_S, 0.0, 3.0), (4.0, 0.0, 0.0)), FLYING, NOWHERE, NOWHERE)
    assert vehicle.velocity_mps[0, 0] == pytest.approx(4.0, abs=0.02)
    assert vehicle.thrust_mps2[0] == pytest.approx([0.5 * 4.0, 0.0, 0.0], abs=0.05)


def test_each_vehicle_may_have_its_own_gains_and_others_in_flight():
    truths = [MultirotorTruth(gust_mps2=0.0), MultirotorTruth(gust_mps2=0.0, position_gain_ps=1.4)]
    both = Multirotors(truths, np.zeros((2, 3)), np.zeros(2), STEP_S, np.random.default_rng(1))
    place, none = np.full((2, 3), 2.0), np.zeros((2, 3))
    for _ in range(20):
        both.step(Setpoints(place, none, none, np.zeros(2), np.zeros(2)), np.zeros(2, dtype=bool), none, none)
    slow, quick = both.position_m[:, 0].tolist()
    assert quick > 1.2 * slow
    both.equip(0, truths[1])
    both.position_m[:], both.velocity_mps[:] = 0.0, 0.0
    for _ in range(400):
        both.step(Setpoints(place, none, none, np.zeros(2), np.zeros(2)), np.zeros(2, dtype=bool), none, none)
    np.testing.assert_allclose(both.position_m[0], both.position_m[1], atol=1e-3)


@pytest.mark.parametrize(
    "gains", [{"position_gain_ps": 9.0}, {"attitude_rate_ps": 0.5, "drag_ps": 0.0}, {"thrust_rate_ps": 1.0, "drag_ps": 0.0}]
)
def test_refuses_unstable_gains(gains):
    with pytest.raises(ConfigError, match="is unstable"):
        MultirotorTruth(**gains).check("scenario.toml")
    MultirotorTruth().check("scenario.toml")


def test_on_the_ground_nothing_moves_and_nothing_is_integrated():
    vehicle = still([[1.0, 2.0, 0.0]])
    fly(vehicle, 5.0, grounded=np.array([True]), position=(1.0, 2.0, -1.0), yaw=1.0)
    assert vehicle.position_m[0].tolist() == [1.0, 2.0, 0.0]
    assert vehicle.velocity_mps[0].tolist() == [0.0, 0.0, 0.0]
    assert vehicle.yaw_rad[0] == 0.0
    fresh = still([[1.0, 2.0, 0.0]])
    fresh.step(asked((1.0, 2.0, -1.0)), np.array([True]), NOWHERE, NOWHERE)
    np.testing.assert_allclose(fly(vehicle, 1.0, position=(1.0, 2.0, 3.0)), fly(fresh, 1.0, position=(1.0, 2.0, 3.0)))


def test_attitude_points_the_thrust():
    w, x, y, z = attitude(0.7, 1.0, 2.0, 0.3)
    rotation = Rotation.from_quat((x, y, z, w))
    thrust = np.array([1.0, 2.0, 0.3 + GRAVITY_MPS2])
    np.testing.assert_allclose(rotation.apply([0, 0, 1]), thrust / np.linalg.norm(thrust), atol=1e-12)
    assert rotation.as_euler("ZYX")[0] == pytest.approx(0.7)


def test_heading_follows_the_shorter_way():
    vehicle = still()
    vehicle.yaw_rad[:] = 3.0
    fly(vehicle, 8.0, yaw=-3.0)
    assert vehicle.yaw_rad[0] == pytest.approx(2 * np.pi - 3.0, abs=0.01)


@pytest.mark.parametrize("step_s", [0.01, 0.05])
@pytest.mark.parametrize(
    ("degrees", "t10", "t50", "t90", "overshoot"), [(90.0, 0.36, 0.66, 0.94, 15.0), (179.0, 0.43, 0.94, 1.39, 20.0)]
)
def test_turns_as_measured_on_px4(step_s, degrees, t10, t50, t90, overshoot):
    vehicle = still(step_s=step_s)
    fly(vehicle, 0.05, step_s)
    done = []
    for _ in range(round(5.0 / step_s)):
        vehicle.step(asked(yaw=np.deg2rad(degrees)), FLYING, NOWHERE, NOWHERE)
        done.append(np.rad2deg(vehicle.yaw_rad[0]) / degrees)
    for share, measured_s in ((0.1, t10), (0.5, t50), (0.9, t90)):
        assert (np.argmax(np.array(done) > share) + 1) * step_s == pytest.approx(measured_s, abs=0.1)
    assert (max(done) - 1.0) * degrees == pytest.approx(overshoot, abs=6.0)


@pytest.mark.parametrize(("heading", "behind_s"), [(True, 0.04), (False, 0.54)])
def test_turning_on_and_on(heading, behind_s):
    """With the heading to follow as well, or the rate alone."""
    vehicle = still()
    fly(vehicle, STEP_S)
    for step in range(400):
        yaw = 0.5 * step * STEP_S if heading else np.nan
        vehicle.step(asked(yaw=yaw, yaw_rate=0.5), FLYING, NOWHERE, NOWHERE)
    lag_s = (0.5 * 400 * STEP_S - vehicle.yaw_rad[0]) / 0.5
    assert lag_s == pytest.approx(behind_s, abs=0.1)


def test_the_yaw_rate_that_is_fed_forward_turns_the_tilt():
    """Measured on the circle of 12 m at 3 m/s, in one run: 0.5 m closer in with 1.5 rad/s; without, 0.71 m too far out."""
    vehicle = still([[12.0, 0.0, 3.0]])
    radii = []
    for step in range(1500):
        east = circle(step * STEP_S, 12.0, 3.0, acceleration=True)
        vehicle.step(
            east._replace(yaw_rad=np.array([1.5 * step * STEP_S]), yaw_rate_rps=np.array([1.5])), FLYING, NOWHERE, NOWHERE
        )
        radii.append(np.hypot(*vehicle.position_m[0, :2]))
    assert 11.7 < np.mean(radii[1000:]) < 12.71 - 0.3
