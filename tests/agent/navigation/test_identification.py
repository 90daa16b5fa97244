"""Identification in flight, and plan following with it, for vehicles that differ from the configured ones."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.drone import ResponseConfig
from radron.agent.motion.feedforward import MOST_MPS2, Deviation, feedforward
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.navigation.drag import DragFilter, horizontal_thrust
from radron.agent.navigation.identification import BAD_M, FoundResponse, ResponseEstimator
from radron.agent.vehicle.interface import FlightMode, VehicleState
from support.flights.closed_loop import TICK_S, Flight, Swarm, Vehicle, encircle, go_to

SECOND = 1_000_000_000
NO_LAGS = ResponseConfig(drag_ps=0.0, attitude_lag_s=0.0, derivative_gain=0.0)
CIRCLE_M, SEARCH_M = 0.6, 0.9  # permitted deviation of a vehicle from its plan, RMS
AS_RECORDED = 2.0  # noise: 0.18 m and 0.14 m/s of each axis, as a PX4 was recorded in flight


class Search:
    """From one place to the next at the speed of the search."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._goal = self._next()

    def _next(self) -> tuple[float, float]:
        x, y = self._rng.uniform(-40.0, 40.0, 2).tolist()
        return x, y

    def __call__(self, me: PeerState, others: Mapping[str, PeerState], my_id: str) -> Reference:
        if np.hypot(self._goal[0] - me.position[0], self._goal[1] - me.position[1]) < 4.0:
            self._goal = self._next()
        return go_to({my_id: self._goal}, 6.5)(me, others, my_id)


class AsConfigured(ResponseEstimator):
    """Finds nothing."""

    def follow(self, vehicle: VehicleState) -> None:
        pass

    def compare(self, vehicle: VehicleState, planned: PeerState) -> None:
        pass


def swarm(seed: int = 1, noise: float = AS_RECORDED, response: ResponseConfig | None = None, **vehicle: float) -> Swarm:
    return Swarm(np.random.default_rng(seed), np.zeros((1, 2)), noise=noise, response=response, **vehicle)


def rms_m(flight: Flight) -> float:
    return float(np.sqrt(np.mean(flight.deviation**2)))


def search_and_circle(one: Swarm) -> tuple[float, float]:
    """Deviations RMS."""
    return rms_m(one.fly(40.0, Search(3))), rms_m(one.fly(40.0, encircle((0.0, 0.0))))


def told(now_s: float, position: float, velocity: float, thrust: float, **values: object) -> VehicleState:
    """Along x."""
    vehicle = Vehicle(np.zeros(3), acceleration=np.array([thrust, 0.0, 0.0]))
    state = VehicleState(
        stamp_ns=round(now_s * SECOND),
        epoch=0,
        position_m=(position, 0.0, 3.0),
        velocity_mps=(velocity, 0.0, 0.0),
        quaternion=vehicle.quaternion(),
        height_m=3.0,
        position_sigma_m=0.1,
        yaw_sigma_rad=0.0,
        mode=FlightMode.OFFBOARD,
        armed=True,
        in_air=True,
        healthy=True,
    )
    return replace(state, **values)


def swinging(drag: float, duration_s: float, begin_s: float = 0.0, **values: object) -> list[VehicleState]:
    """Telemetry without errors of a vehicle that goes to and fro along x."""
    times = begin_s + np.arange(0.0, duration_s, TICK_S)
    return [
        told(t, 5.0 * np.sin(t), 5.0 * np.cos(t), -5.0 * np.sin(t) + drag * 5.0 * np.cos(t), **values) for t in times.tolist()
    ]


@pytest.mark.parametrize(("drag", "yaw_rate_rps"), [(0.0, 0.0), (0.3, 0.0), (1.0, 0.0), (1.0, 0.5)])
def test_a_vehicle_that_is_known_flies_its_plan(drag: float, yaw_rate_rps: float) -> None:
    known = ResponseConfig(drag_ps=drag, attitude_lag_s=0.22, lag_s=0.075)  # dead time: a tick, and half of one
    one = swarm(noise=0.0, response=known, drag=drag, yaw_rate_rps=yaw_rate_rps)
    one.responses = [AsConfigured(known)]
    search_m, circle_m = search_and_circle(one)
    assert search_m < 0.1
    assert circle_m < 0.1


@pytest.mark.parametrize(("drag", "assumed"), [(0.3, 0.5), (1.0, 0.5), (1.0, 0.0), (0.0, 1.0)])
def test_a_wrong_drag_is_found_within_15_s_of_search(drag: float, assumed: float) -> None:
    one = swarm(response=ResponseConfig(drag_ps=assumed), drag=drag)
    one.fly(15.0, Search(3))
    assert one.responses[0].response.drag_ps == pytest.approx(drag, abs=0.1)


@pytest.mark.parametrize(
    "vehicle",
    [
        {"drag": 0.3},
        {"drag": 1.0},
        {"drag": 0.0},
        {"drag": 0.1, "quadratic": 0.06},
        {"drag": 1.0, "position_gain": 1.4},
        {"drag": 1.0, "velocity_gain": 3.0},
        {"drag": 1.0, "attitude_lag_s": 0.15},
        {"drag": 0.3, "attitude_lag_s": 0.35},
        {"drag": 1.0, "integral_gain": 0.0},
        {"drag": 1.0, "yaw_rate_rps": 0.5},
    ],
    ids=str,
)
def test_whatever_the_vehicle_it_follows_its_plans(vehicle: dict[str, float]) -> None:
    search_m, circle_m = search_and_circle(swarm(**vehicle))
    assert search_m < SEARCH_M
    assert circle_m < CIRCLE_M


def test_wind_is_not_taken_for_drag() -> None:
    one = swarm(drag=0.5, wind=np.array([4.0, 2.0, 0.0]))
    one.fly(30.0, Search(3))
    assert one.responses[0].response.drag_ps == pytest.approx(0.5, abs=0.1)
    assert rms_m(one.fly(30.0, encircle((0.0, 0.0)))) < CIRCLE_M


def test_an_autopilot_that_ignores_accelerations_follows_no_worse_than_without() -> None:
    bare = swarm(response=NO_LAGS, drag=1.0, feedforward=0.0)
    bare.responses = [AsConfigured(NO_LAGS)]
    without = search_and_circle(bare)
    ours = search_and_circle(swarm(drag=1.0, feedforward=0.0))
    assert ours[0] < 1.02 * without[0]
    assert ours[1] < without[1]


def test_a_dead_time_is_found_by_what_the_vehicle_is_late() -> None:
    one = swarm(delay_ticks=6)
    one.fly(60.0, encircle((0.0, 0.0)))
    assert one.responses[0].response.lag_s == pytest.approx(0.325, abs=0.05)  # 6 ticks, and half of one for the setpoints' period


def test_a_tilt_that_tells_nothing_leaves_the_drone_files_drag() -> None:
    """A vehicle that pushes sideways with its rotors while it stays level."""
    level = ResponseEstimator(ResponseConfig(drag_ps=0.7))
    for state in swinging(1.0, 20.0):
        level.follow(replace(state, quaternion=(1.0, 0.0, 0.0, 0.0)))
    assert level.response.drag_ps == pytest.approx(0.7, abs=0.05)


def test_who_hovers_learns_nothing_of_the_drag() -> None:
    rng, drag = np.random.default_rng(0), DragFilter(0.5)
    wander = np.zeros(2)
    for tick in range(1200):
        wander = 0.985 * wander + np.array([0.03, 0.05]) * rng.standard_normal(2)
        drag.follow(told(tick * TICK_S, float(wander[0]), float(wander[1]), 0.0))
    assert drag.drag_ps == pytest.approx(0.5)
    assert drag.sigma_ps > 0.3


def test_a_jump_of_the_frame_is_no_acceleration() -> None:
    drag = DragFilter(0.5)
    for state in swinging(1.0, 10.0):
        drag.follow(state)
    for state in swinging(1.0, 10.0, begin_s=10.0, epoch=1):
        (x, y, z), (speed, _, _) = state.position_m, state.velocity_mps
        drag.follow(replace(state, position_m=(y, x + 100.0, z), velocity_mps=(0.0, speed, 0.0), quaternion=turned(state)))
    assert drag.fits
    assert drag.drag_ps == pytest.approx(1.0, abs=0.05)


def turned(state: VehicleState) -> tuple[float, float, float, float]:
    """The attitude in a frame in which x is y: its thrust there."""
    thrust = horizontal_thrust(state.quaternion)
    assert thrust is not None
    return Vehicle(np.zeros(3), acceleration=np.array([0.0, thrust[0], 0.0])).quaternion()


def test_on_the_ground_nothing_is_learnt() -> None:
    estimator = ResponseEstimator(ResponseConfig())
    for state in swinging(1.0, 10.0):
        estimator.follow(replace(state, in_air=False))
    assert estimator.response == ResponseConfig()


def test_what_was_found_before_a_restart_is_gone_on_with() -> None:
    estimator = ResponseEstimator(ResponseConfig(drag_ps=0.2))
    estimator.remember(FoundResponse(1.0, 0.1, 0.3))
    assert (estimator.response.drag_ps, estimator.response.lag_s) == (1.0, 0.1)
    assert estimator.found == FoundResponse(1.0, 0.1, 0.3)
    for state in swinging(0.4, 20.0):  # another vehicle's
        estimator.follow(state)
    assert estimator.response.drag_ps == pytest.approx(0.4, abs=0.1)


def test_who_does_not_follow_is_told_until_it_does() -> None:
    estimator, now_s = ResponseEstimator(ResponseConfig()), 0.0
    assert estimator.problem is None
    for apart, expected in ((2.0 * BAD_M, True), (0.2, False)):
        for _ in range(600):
            now_s += TICK_S
            estimator.compare(told(now_s, apart, 0.0, 0.0), PeerState((0.0, 0.0, 3.0)))
        assert (estimator.problem is not None) is expected


def test_a_deviation_counts_by_how_long_it_lasts() -> None:
    seldom, often = Deviation(0.0), Deviation(0.0)
    for tick in range(200):
        often.add(tick * SECOND // 20, 0.6, 0.8)
        if tick % 2 == 0:
            seldom.add(tick * SECOND // 20, 0.6, 0.8)
    assert seldom.rms_m == pytest.approx(often.rms_m, abs=0.01)
    assert 0.7 < often.rms_m < 0.9  # of 1 m for 10 s, the time over which it is averaged


def test_no_setpoint_asks_for_more_tilt_than_there_is() -> None:
    x, y, z = feedforward(ResponseConfig(drag_ps=1.0), (6.0, 3.0, 1.0), (4.0, 2.0, 0.5), (20.0, 10.0))
    assert np.hypot(x, y) == pytest.approx(MOST_MPS2)
    assert y / x == pytest.approx(0.5)
    assert z == pytest.approx(1.5)
