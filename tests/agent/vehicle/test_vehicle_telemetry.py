"""From messages to the state: heights, sigmas, health, and missing data."""

from math import atan2, cos, pi, radians, sin

import pytest

from radron.agent.config.drone import VehicleConfig
from radron.agent.vehicle.interface import FlightMode, LaunchPlace, VehicleState
from radron.agent.vehicle.mavlink.messages import (
    Attitude,
    Battery,
    DistanceSensor,
    EstimatorStatus,
    ExtendedState,
    GlobalOrigin,
    GpsRaw,
    Heartbeat,
    HomePosition,
    LocalPosition,
    Message,
    Odometry,
    SystemStatus,
)
from radron.agent.vehicle.telemetry import FRESH_S, LOST_S, Telemetry

HOLD, OFFBOARD = 0x3040000, 0x60000
STILL = (0.0, 0.0, 0.0)
SENSORS = 0x1000_0027
ON_GROUND: tuple[Message, ...] = (
    Heartbeat(0x1D, HOLD, 3),
    ExtendedState(1),
    SystemStatus(SENSORS, SENSORS, SENSORS, 90),
    HomePosition(0, 0),
    GlobalOrigin(473977420, 85455940, 488000),
    Attitude(0, 1.0, 0.0, 0.0, 0.0, *STILL),
)


class Rig:
    """Telemetry with a clock: each position is 1/30 s later than the last, with the attitude given."""

    def __init__(self, *messages: Message, gnss: bool = True, stored: LaunchPlace | None = None) -> None:
        self.telemetry = Telemetry(VehicleConfig(position_sigma_m=0.15, gnss=gnss), stored)
        self.now_s = 10.0
        self.give(*messages)

    def give(self, *messages: Message) -> VehicleState | None:
        state = None
        for message in messages:
            state = self.telemetry.receive(message, round(self.now_s * 1e9), self.now_s) or state
        return state

    def attitude(self, w: float | None = 1.0, x: float = 0.0, rates_rps: tuple[float, float, float] = STILL) -> None:
        self.give(Attitude(round(self.now_s * 1e3), w, x, 0.0, 0.0, *rates_rps))

    def position(self, x: float = 0.0, y: float = 0.0, z: float | None = 0.0, level: bool = True) -> VehicleState | None:
        self.now_s += 1 / 30
        if level:
            self.attitude()
        return self.give(LocalPosition(round(self.now_s * 1e3), x, y, z, 0.1, 0.2, 0.3))


def launched(*messages: Message) -> Rig:
    """A vehicle that has stood on the ground for 2 s."""
    rig = Rig(*ON_GROUND)
    for _ in range(60):
        rig.position()
    rig.give(*messages)
    return rig


def state_of(rig: Rig, *where: float) -> VehicleState:
    state = rig.position(*where)
    assert state is not None
    return state


def test_a_vehicle_on_the_ground_is_healthy_at_the_origin() -> None:
    rig = launched(Battery(0, 77))
    state = state_of(rig)
    assert (state.armed, state.in_air, state.healthy, state.mode) == (False, False, True, FlightMode.HOLD)
    assert state.position_m == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert state.velocity_mps == pytest.approx((0.2, 0.1, -0.3))
    assert state.battery == 0.77
    assert abs(state.stamp_ns - rig.now_s * 1e9) < 1e6
    assert rig.telemetry.problems(rig.now_s) == []


@pytest.mark.parametrize("missing", [0, 1, 4])
def test_there_is_no_state_without_heartbeat_landed_state_or_origin(missing: int) -> None:
    rig = Rig(*(message for number, message in enumerate(ON_GROUND) if number != missing))
    assert all(rig.position() is None for _ in range(60))
    assert rig.telemetry.problems(rig.now_s) != []


def test_there_is_no_state_with_a_stale_attitude_or_half_a_position() -> None:
    rig = launched()
    assert rig.position(z=None) is None
    for w in (None, 0.0, 1.02):
        rig.attitude(w=w)  # of no rotation
        assert rig.position(level=False) is None
    state_of(rig)
    rig.now_s += FRESH_S
    assert rig.position(level=False) is None


def test_what_keeps_it_from_arming_is_told() -> None:
    rig = launched(SystemStatus(SENSORS, SENSORS, 0x07, 90))
    assert not state_of(rig).healthy
    assert rig.telemetry.problems(rig.now_s) == ["the autopilot is not ready to arm in mode hold: GPS"]
    assert not state_of(launched(Heartbeat(0x1D, HOLD, 0))).healthy


def test_in_the_air_health_means_no_failsafe() -> None:
    rig = launched(Heartbeat(0x91, OFFBOARD, 4), ExtendedState(2), SystemStatus(SENSORS, SENSORS, 0x07, 90))
    state = state_of(rig)
    assert (state.armed, state.in_air, state.healthy, state.mode) == (True, True, True, FlightMode.OFFBOARD)
    rig.give(Heartbeat(0x9D, 0x5040000, 5))
    assert not state_of(rig).healthy
    assert rig.telemetry.problems(rig.now_s) == ["the autopilot is in a failsafe"]


def test_the_launch_place_stays_the_origin_in_flight() -> None:
    rig = launched(Heartbeat(0x91, OFFBOARD, 4), ExtendedState(2))
    assert state_of(rig, 3.0, 4.0, -5.0).position_m == pytest.approx((4.0, 3.0, 5.0))


def test_height_is_by_the_rangefinder_when_it_is_fresh_and_within_its_limits() -> None:
    rig = launched(Heartbeat(0x91, OFFBOARD, 4), ExtendedState(2))
    assert state_of(rig, 0.0, 0.0, -5.0).height_m == pytest.approx(5.0)
    rig.give(DistanceSensor(10, 1500, 450, 25))
    assert state_of(rig, 0.0, 0.0, -5.0).height_m == pytest.approx(4.5)
    rig.now_s += FRESH_S
    assert state_of(rig, 0.0, 0.0, -5.0).height_m == pytest.approx(5.0)
    for unusable in (
        DistanceSensor(10, 1500, 1500, 25),
        DistanceSensor(10, 1500, 5, 25),
        DistanceSensor(10, 1500, 450, 0),
        DistanceSensor(10, 1500, 450, 25, 1),
    ):
        rig.give(unusable)
        assert state_of(rig, 0.0, 0.0, -5.0).height_m == pytest.approx(5.0)


def test_the_rangefinder_tilts_with_the_body() -> None:
    rig = launched(Heartbeat(0x91, OFFBOARD, 4), ExtendedState(2), DistanceSensor(10, 1500, 1000, 25))
    half = radians(30.0) / 2
    rig.attitude(cos(half), sin(half))
    state = rig.position(level=False)
    assert state is not None
    assert state.height_m == pytest.approx(10.0 * cos(radians(30.0)))


def test_the_estimators_own_sigma_counts_where_it_is_larger() -> None:
    rig = launched(EstimatorStatus(0.05, 0.1))
    assert state_of(rig).position_sigma_m == 0.15
    rig.give(EstimatorStatus(0.05, 0.4))
    assert state_of(rig).position_sigma_m == 0.4
    rig.give(EstimatorStatus(None, None))
    assert state_of(rig).position_sigma_m == 0.15


def test_a_lost_link_is_told_and_nothing_else() -> None:
    rig = launched(SystemStatus(SENSORS, SENSORS, 0x07, 90))
    problems = rig.telemetry.problems(rig.now_s + LOST_S + 3.0)
    assert len(problems) == 1
    assert "lost" in problems[0]


def test_the_attitude_is_that_of_the_positions_time() -> None:
    rig = launched()
    rig.attitude(rates_rps=(0.0, 0.0, 0.6))  # clockwise, from north
    state = rig.position(level=False)
    assert state is not None
    w, _, _, z = state.quaternion
    assert 2.0 * atan2(z, w) == pytest.approx(pi / 2 - 0.6 / 30, abs=1e-3)  # from east, counter-clockwise; stamps are in whole ms


def count(rig: Rig, resets: int) -> None:
    rig.give(Odometry(round(rig.now_s * 1e6), resets))


def test_a_frame_that_jumps_in_flight_is_another_epoch_from_the_first_state_in_it_on() -> None:
    rig = launched(Heartbeat(0x91, OFFBOARD, 4), ExtendedState(2))
    count(rig, 3)
    assert state_of(rig).epoch == 0
    count(rig, 4)
    states = []
    for _ in range(30):
        states.append(rig.position(16.0))
        assert rig.telemetry.frame_in_doubt is (states[-1] is None)
    told = [state for state in states if state is not None]
    assert {(state.epoch, round(state.position_m[1], 6)) for state in told} == {(1, 16.0)}
    assert len(told) >= 25
    assert rig.telemetry.launch.to_keep is not None
    assert (rig.telemetry.launch.to_keep.epoch, rig.telemetry.launch.to_keep.resets) == (1, 4)


def test_a_fix_is_what_the_receiver_says_at_its_own_time() -> None:
    rig = launched()
    place = {"lat": 473977420, "lon": 85455940, "alt_ellipsoid": 535123, "h_acc": 850, "v_acc": 1300}
    at_us = round(rig.now_s * 1e6) - 150_000
    fix = rig.telemetry.fix(GpsRaw(at_us, 3, **place))
    assert fix is not None
    assert abs(fix.stamp_ns - at_us * 1000) < 1e6
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((47.397742, 8.545594), abs=1e-9)
    assert (fix.altitude_m, fix.horizontal_sigma_m, fix.vertical_sigma_m) == pytest.approx((535.123, 0.85, 1.3))
    assert rig.telemetry.fix(GpsRaw(at_us, 2, **place)) is None
    assert rig.telemetry.fix(GpsRaw(at_us, 3, **(place | {"h_acc": 0}))) is None
    assert Rig(*ON_GROUND).telemetry.fix(GpsRaw(at_us, 3, **place)) is None  # its clock is not known yet


def test_without_satellites_neither_origin_nor_home_is_missed() -> None:
    others = [message for message in ON_GROUND if not isinstance(message, HomePosition | GlobalOrigin)]
    rig = Rig(*others, gnss=False)
    for _ in range(60):
        rig.position()
    assert state_of(rig).healthy
    assert rig.telemetry.problems(rig.now_s) == []
    rig.give(SystemStatus(0x27, 0x27, 0x1000_0007, 90))  # a receiver without reception
    assert rig.telemetry.problems(rig.now_s) == []


@pytest.mark.parametrize("in_air", [True, False])
@pytest.mark.parametrize("resets", [3, 4])
@pytest.mark.parametrize("at", [-1, 0, 1, 5])
def test_a_reset_while_no_agent_ran_is_noticed_whenever_its_count_comes(in_air: bool, resets: int, at: int) -> None:
    """The count comes at 10 Hz, the heartbeat at 1 Hz, positions at 30 Hz, in any order. In flight another frame is another
    epoch, on the ground the launch place is measured again; before that is known no state is given.
    """
    stored = LaunchPlace(
        north_m=1.0,
        east_m=2.0,
        down_m=0.0,
        origin_latitude_deg=47.397742,
        origin_longitude_deg=8.545594,
        origin_altitude_m=488.0,
        resets=3,
        flown=True,
    )
    condition = (Heartbeat(0x9D, OFFBOARD, 4), ExtendedState(2)) if in_air else (Heartbeat(0x1D, HOLD, 3), ExtendedState(1))
    rig = Rig(*(message for message in ON_GROUND if not isinstance(message, Heartbeat | ExtendedState)), stored=stored)
    states = []
    for step in range(-15, 60):
        rig.give(*(condition if step == 0 else ()))
        rig.give(*((Odometry(round(rig.now_s * 1e6), resets),) if step == at or step > 5 else ()))
        states.append(rig.position(6.0, 2.0, 0.0))
    told = [state for state in states if state is not None]
    moved = resets != stored.resets
    assert {state.epoch for state in told} == {int(moved and in_air)}
    measured_again = moved and not in_air
    assert told[-1].position_m[1] == pytest.approx(0.0 if measured_again else 5.0)
