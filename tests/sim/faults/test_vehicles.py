"""Faults of vehicles: gusts, a failed motor, batteries, the MAVLink link, a human pilot, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from radron.agent.vehicle.interface import FlightMode, Request, Setpoint, VehicleCommand
from radron.sim.faults.base import Fault
from radron.sim.faults.machines import Battery, Gust, MavlinkLoss, MotorFailure, Refusal, Takeover
from radron.sim.faults.schedule import Schedule
from radron.sim.faults.vehicles import VehicleFaults
from radron.sim.vehicle.autopilot import Autopilot
from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth, Setpoints

STEP_S = 0.05
OFFBOARD = VehicleCommand(Request.OFFBOARD, Setpoint((0.0, 0.0, 5.0), (0.0,) * 3, (0.0,) * 3, 0.0, 0.0))


class World:
    """Two vehicles with ideal localisation in the air, commanded to stay where they are; the first one has the faults."""

    def __init__(self, *faults: Fault) -> None:
        self.schedule = Schedule(faults, ["d1", "d2"], 1)
        truth = MultirotorTruth(gust_mps2=0.0)
        self.motion = Multirotors(
            truth, np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0]]), np.zeros(2), STEP_S, np.random.default_rng(1)
        )
        self.autopilots = [Autopilot((x, 0.0, 0.0), 0.0, STEP_S) for x in (0.0, 9.0)]
        self.faults = VehicleFaults(self.schedule, self.autopilots, self.motion, STEP_S)
        self.time_s = -12.0
        self.heard = 0
        self.fly(12.0, VehicleCommand(Request.TAKEOFF, takeoff_height_m=5.0))

    def fly(self, duration_s: float, command: VehicleCommand = OFFBOARD) -> FlightMode:
        for _ in range(round(duration_s / STEP_S)):
            self.schedule.advance(self.time_s)
            self.faults.step()
            self.heard += self.faults.hears(0)
            for autopilot, (x, y, z) in zip(self.autopilots, self.motion.position_m.tolist(), strict=True):
                autopilot.command(command)
                autopilot.step((x, y, z))
            targets = [autopilot.target for autopilot in self.autopilots]
            setpoints = Setpoints(
                np.array([target.position for target in targets]),
                np.array([target.velocity for target in targets]),
                np.array([target.acceleration for target in targets]),
                np.array([target.yaw for target in targets]),
                np.array([target.yaw_rate for target in targets]),
            )
            grounded = np.array([autopilot.grounded for autopilot in self.autopilots])
            self.motion.step(setpoints, grounded, np.zeros((2, 3)), np.zeros((2, 3)))
            if self.motion.any_falls:
                self.motion.rest_on(np.zeros(2))
            self.time_s += STEP_S
        return self.autopilots[0].mode

    @property
    def place_m(self) -> np.ndarray:
        return self.motion.position_m[0]


def test_a_gust_blows_the_vehicle_away_until_the_integrator_has_it() -> None:
    """Against a constant push of 2 m/s2 the cascade's position error peaks at about a metre and is integrated away."""
    world = World(Gust(at_s=1.0, for_s=10.0, target="d1"))
    world.fly(1.0)
    calm = world.place_m.copy()
    world.fly(1.5)
    assert 0.3 < np.hypot(*(world.place_m - calm)[:2]) < 3.0
    assert abs(world.place_m[2] - calm[2]) < 0.3
    world.fly(25.0)
    assert np.hypot(*(world.place_m - calm)[:2]) < 0.3
    assert not world.motion.push_mps2.any()


def test_a_failed_motor_brings_the_vehicle_down_spinning_and_it_stays_there() -> None:
    world = World(MotorFailure(at_s=1.0, target="d1", descent_mps=3.0))
    world.fly(2.5)
    assert world.autopilots[0].failsafe
    assert world.motion.velocity_mps[0, 2] == pytest.approx(-3.0, abs=0.3)
    yaw = world.motion.yaw_rad[0]
    world.fly(0.5)
    assert world.motion.yaw_rad[0] - yaw > 1.0
    world.fly(5.0)
    assert not world.autopilots[0].armed
    assert world.autopilots[0].failsafe
    assert world.place_m[2] == pytest.approx(0.0, abs=1e-6)
    lies = world.place_m.copy()
    world.fly(2.0, VehicleCommand(Request.TAKEOFF, takeoff_height_m=5.0))
    assert (world.place_m == lies).all()
    assert world.motion.position_m[1, 2] > 4.0  # the other one flies on


def test_a_battery_is_reported_and_at_critical_level_the_autopilot_returns() -> None:
    world = World(Battery(at_s=1.0, target="d1", level=0.085, drain_ps=0.005))
    world.fly(1.5)
    assert world.faults.battery(0) == pytest.approx(0.08, abs=0.011)
    assert world.faults.battery(1) > 0.95
    world.fly(4.5)
    assert world.autopilots[0].mode is FlightMode.HOLD  # for five seconds
    assert world.autopilots[0].failsafe
    world.fly(6.0)
    assert world.autopilots[0].mode in (FlightMode.RETURN, FlightMode.LAND)
    assert world.autopilots[1].mode is FlightMode.OFFBOARD


@pytest.mark.parametrize("mode", ["manual", "hold"])
def test_a_battery_that_gets_low_while_a_human_pilot_flies_is_acted_on_when_the_vehicle_is_given_back(mode) -> None:
    pilot = Takeover(at_s=1.0, for_s=9.0, target="d1", mode=mode)
    world = World(pilot, Battery(at_s=1.0, for_s=6.0, target="d1", level=0.08, drain_ps=0.0025))
    release = VehicleCommand(Request.RELEASE)
    assert world.fly(9.5, release) is FlightMode(mode)
    world.fly(1.0, release)  # given back at 10 s
    assert world.autopilots[0].failsafe
    assert world.fly(5.5, release) is FlightMode.RETURN


def test_a_battery_that_was_only_said_to_be_low_is_not_acted_on() -> None:
    lie = Battery(at_s=1.0, for_s=6.0, target="d1", level=0.06, lies=True)
    world = World(Takeover(at_s=1.0, for_s=9.0, target="d1", mode="manual"), lie)
    assert world.fly(20.0, VehicleCommand(Request.RELEASE)) is FlightMode.HOLD
    assert not world.autopilots[0].failsafe


def test_an_empty_battery_brings_the_vehicle_down_unless_it_lies() -> None:
    empty, lying = (
        World(Battery(at_s=1.0, target="d1", level=0.01, drain_ps=0.01, acts=False, lies=lies)) for lies in (False, True)
    )
    for world in (empty, lying):
        world.fly(8.0)
        assert world.faults.battery(0) == 0.0
    assert not empty.autopilots[0].armed
    assert lying.place_m[2] > 4.0


def test_lost_messages_are_lost_independently() -> None:
    world = World(MavlinkLoss(at_s=1.0, target="d1", probability=0.3))
    world.fly(1.0)
    world.heard = 0
    assert world.fly(50.0) is FlightMode.OFFBOARD  # of a run of twenty lost setpoints there is no chance
    assert world.heard == pytest.approx(700, abs=4.0 * (1000 * 0.3 * 0.7) ** 0.5)


def test_without_any_message_the_vehicle_returns_and_comes_back_when_they_do() -> None:
    world = World(MavlinkLoss(at_s=1.0, for_s=2.0, target="d1", probability=1.0))
    world.fly(2.5)
    assert world.autopilots[0].mode is FlightMode.RETURN
    assert world.autopilots[0].failsafe
    assert world.fly(1.0) is FlightMode.OFFBOARD
    assert not world.autopilots[0].failsafe


def test_a_pilot_in_manual_is_not_disturbed_and_leaves_the_vehicle_in_hold() -> None:
    world = World(Takeover(at_s=1.0, for_s=5.0, target="d1", mode="manual"))
    assert world.fly(2.0) is FlightMode.MANUAL
    assert world.fly(2.0, VehicleCommand(Request.RETURN)) is FlightMode.MANUAL
    assert world.fly(3.0, VehicleCommand(Request.RELEASE)) is FlightMode.HOLD
    assert world.fly(1.0) is FlightMode.OFFBOARD


def test_a_mode_chosen_by_a_pilot_stays_until_there_is_a_new_request() -> None:
    world = World(Takeover(at_s=1.0, target="d1", mode="hold"))
    assert world.fly(4.0) is FlightMode.HOLD
    assert world.fly(1.0, VehicleCommand(Request.LAND)) is FlightMode.LAND


def test_a_refusing_autopilot_follows_setpoints_but_no_change_of_mode() -> None:
    world = World(Refusal(at_s=1.0, for_s=4.0, target="d1"))
    world.fly(2.0)
    moved = VehicleCommand(Request.OFFBOARD, Setpoint((2.0, 0.0, 5.0), (0.0,) * 3, (0.0,) * 3, 0.0, 0.0))
    assert world.fly(2.0, moved) is FlightMode.OFFBOARD
    assert world.autopilots[0].target.position == (2.0, 0.0, 5.0)
    assert world.fly(0.5, VehicleCommand(Request.LAND)) is FlightMode.OFFBOARD
    assert world.fly(1.0, VehicleCommand(Request.LAND)) is FlightMode.LAND
