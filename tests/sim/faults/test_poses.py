"""Faults of the own position: the vehicle's estimate, and its driver's report."""

from __future__ import annotations

import numpy as np
import pytest

from radron.agent.config.mission import DatumConfig
from radron.agent.vehicle.interface import FlightMode, Request, Setpoint, VehicleCommand
from radron.sim.campaign.faults.mission import Mission
from radron.sim.faults.base import Fault
from radron.sim.faults.machines import Drag, HeadingReset, PositionJump, SatellitesLost
from radron.sim.faults.poses import PoseFaults, with_filter_errors
from radron.sim.faults.schedule import Schedule
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import parse_scenario
from radron.sim.scoring.invariants.base import Setting
from radron.sim.scoring.invariants.judge import Judge
from radron.sim.vehicle.autopilot import Autopilot
from radron.sim.world.localization import Localization, LocalizationTruth
from radron.sim.world.localizers import VehicleTruth
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.streams import streams

STEP_S = 0.05
PLACES = np.array([[0.0, 0.0, 5.0], [9.0, 0.0, 5.0]])
EXACT = LocalizationTruth(horizontal_m=0.0, vertical_m=0.0, velocity_mps=0.0, climb_mps=0.0, drift_m=0.0)
OFFBOARD = VehicleCommand(Request.OFFBOARD, Setpoint((0.0, 0.0, 5.0), (0.0,) * 3, (0.0,) * 3, 0.0, 0.0))


class World:
    """Two vehicles at rest in the air; the first one has the faults."""

    def __init__(self, *faults: Fault, vehicles: dict[str, VehicleTruth] | None = None) -> None:
        random, names = streams(1, 2), ["d1", "d2"]
        datum = DatumConfig(latitude_deg=47.0, longitude_deg=8.0, altitude_m=500.0)
        truth = LocalizationTruth(vehicles=vehicles or {}, horizontal_m=0.0, vertical_m=0.0, drift_m=0.0)
        self.schedule = Schedule(faults, names, 1)
        layout = [((0.0, 0.0, 0.0), 0.0), ((9.0, 0.0, 0.0), 0.0)]
        self.frames = MovingFrames(truth, names, layout, datum, STEP_S, random)
        self.errors = with_filter_errors(faults, Localization(EXACT, 2, STEP_S, random.localization), STEP_S)
        self.autopilots = [Autopilot((0.0, 0.0, 0.0), 0.0, STEP_S) for _ in names]
        self.poses = PoseFaults(self.schedule, self.frames, self.errors, self.autopilots, STEP_S)
        self.time_s = 0.0
        for autopilot in self.autopilots:
            for _ in range(160):
                autopilot.command(VehicleCommand(Request.TAKEOFF, takeoff_height_m=5.0))
                autopilot.step(autopilot.target.position)

    def fly(self, duration_s: float, command: VehicleCommand = OFFBOARD, places: np.ndarray = PLACES) -> np.ndarray:
        """Returns the errors of the estimated positions (2, 3), world axes: the vehicles themselves stay where they are."""
        for _ in range(round(duration_s / STEP_S)):
            self.schedule.advance(self.time_s)
            for autopilot, place in zip(self.autopilots, self.estimates, strict=True):
                autopilot.command(command)
                autopilot.step(place)
            self.errors.step()
            self.poses.step()
            self.frames.step(self.time_s, places)
            for autopilot, reframing in zip(self.autopilots, self.frames.reframing, strict=True):
                if reframing is not None:
                    autopilot.reframe(reframing)
            self.time_s += STEP_S
        return np.array(self.estimates) - (PLACES - [[0.0, 0.0, 0.0], [9.0, 0.0, 0.0]])

    @property
    def estimates(self):
        return self.frames.local(PLACES + self.errors.position_error_m)


def test_a_jump_is_not_told_and_is_undone() -> None:
    world = World(PositionJump(at_s=1.0, for_s=5.0, target="d1", jump_m=20.0))
    assert np.abs(world.fly(1.0)).max() < 1e-9
    error = world.fly(2.0)
    assert np.hypot(*error[0, :2]) == pytest.approx(20.0)
    assert np.abs(error[1]).max() < 1e-9
    assert world.frames.epoch == [0, 0]
    assert world.poses.trusted(0)
    assert np.abs(world.fly(5.0)).max() < 1e-9


@pytest.mark.parametrize("vehicles", [{}, {"d1": VehicleTruth(kind="rtk")}])
def test_a_jump_that_turns_is_undone_wherever_the_vehicle_has_flown_meanwhile(vehicles: dict[str, VehicleTruth]) -> None:
    """Turned back by 30 degrees 40 m away, its position was 20 m off for good, undetectable for all."""
    world = World(PositionJump(at_s=1.0, for_s=5.0, target="d1", jump_m=2.0, turn_deg=30.0), vehicles=vehicles)
    world.fly(1.0)
    before, yaw_rad = world.frames.origin[0].copy(), world.frames.yaw_rad[0]
    world.fly(1.0)
    assert abs(world.frames.yaw_rad[0] - yaw_rad) == pytest.approx(np.radians(30.0))
    world.fly(10.0, places=PLACES + np.array([40.0, 0.0, 0.0]))
    assert world.frames.yaw_rad[0] == pytest.approx(yaw_rad)
    assert np.hypot(*(world.frames.origin[0] - before)[:2]) < 0.1  # and the receiver's error


def test_an_announced_jump_begins_an_epoch_and_the_target_keeps_its_place_in_the_world() -> None:
    world = World(PositionJump(at_s=1.0, target="d1", jump_m=20.0, turn_deg=30.0, announced=True))
    world.fly(0.9)
    before = world.frames.to_world([[world.autopilots[0].target.position]] * 2)[0, 0] + world.frames.origin[0]
    world.fly(0.2, VehicleCommand(Request.RELEASE))
    after = world.frames.to_world([[world.autopilots[0].target.position]] * 2)[0, 0] + world.frames.origin[0]
    assert world.frames.epoch == [1, 0]
    assert after == pytest.approx(before, abs=1e-6)
    assert abs(world.frames.yaw_rad[0]) == pytest.approx(np.radians(30.0))
    assert not world.poses.trusted(0)
    world.fly(4.0)
    assert world.poses.trusted(0)


def test_reset_of_the_heading_turns_neither_frame_nor_position_and_passes() -> None:
    world = World(HeadingReset(at_s=1.0, target="d1", turn_deg=10.0))
    world.fly(1.0)
    before = world.errors.yaw_error_rad.copy()
    error = world.fly(0.1)
    turned_deg = np.degrees(np.abs(world.errors.yaw_error_rad - before))
    assert turned_deg == pytest.approx([10.0, 0.0], abs=0.7)  # the small errors of both headings vary, too
    assert np.abs(error).max() < 1e-9
    assert world.frames.epoch == [0, 0]
    assert world.frames.yaw_rad[0] == 0.0
    assert world.poses.axes_fixed(0)
    assert world.poses.trusted(0)
    world.fly(30.0)
    assert abs(world.errors.yaw_error_rad[0]) < np.radians(4.0)


def test_heading_of_a_vehicle_by_vision_is_not_reset() -> None:
    world = World(HeadingReset(at_s=1.0, target="d1", turn_deg=10.0), vehicles={"d1": VehicleTruth(kind="slam")})
    world.fly(0.9)
    before = world.errors.yaw_error_rad.copy()
    world.fly(0.2)
    assert np.degrees(np.abs(world.errors.yaw_error_rad - before)) == pytest.approx([0.0, 0.0], abs=0.7)
    assert not world.poses.axes_fixed(0)


def test_spoofed_satellites_drag_position_and_fixes_alike() -> None:
    world = World(Drag(at_s=1.0, target="d1", speed_mps=2.0, most_m=8.0), vehicles={"d1": VehicleTruth(kind="rtk")})
    world.fly(1.0)
    receiver = world.frames.receiver[0]
    assert receiver is not None
    well_m = receiver.error_m[:2].copy()
    error = world.fly(2.0)
    assert np.hypot(*(receiver.error_m[:2] - well_m)) == pytest.approx(4.0, abs=0.2)  # and the error of the receiver
    assert np.hypot(*error[0, :2]) == pytest.approx(2.0 * (2.0 - 1.0 * (1.0 - np.exp(-2.0))), abs=0.2)  # it follows within 1 s
    assert np.hypot(*world.fly(8.0)[0, :2]) == pytest.approx(8.0, abs=0.3)


def test_without_satellites_the_error_grows_is_told_and_the_autopilot_lands() -> None:
    world = World(SatellitesLost(at_s=1.0, for_s=8.0, target="d1", drift_mps2=0.2))
    world.fly(1.0)
    early = world.fly(1.0)
    assert not world.poses.trusted(0)
    assert world.poses.trusted(1)
    assert np.hypot(*early[0, :2]) < world.poses.sigma_m(0, 0.1) < 2.0
    assert world.autopilots[0].mode is FlightMode.OFFBOARD
    late = world.fly(6.0, VehicleCommand(Request.HOLD))
    assert np.hypot(*late[0, :2]) > 4.0
    assert np.hypot(*late[0, :2]) < world.poses.sigma_m(0, 0.1)
    assert world.autopilots[0].mode is FlightMode.LAND
    assert world.autopilots[0].failsafe
    assert world.autopilots[1].mode is FlightMode.HOLD
    regained = world.fly(8.0, VehicleCommand(Request.HOLD))
    assert np.hypot(*regained[0, :2]) < 0.1
    assert world.autopilots[0].mode is FlightMode.HOLD  # chosen last
    assert not world.autopilots[0].failsafe
    assert world.poses.trusted(0)
    assert world.frames.epoch[0] == 1  # the filter was reset


def test_a_vehicle_without_satellites_does_not_miss_them() -> None:
    world = World(SatellitesLost(at_s=0.0, target="d1"), vehicles={"d1": VehicleTruth(kind="slam")})
    assert np.abs(world.fly(5.0)).max() < 0.5
    assert world.poses.trusted(0)


@pytest.mark.slow
def test_a_receiver_without_corrections_that_is_dragged_by_5_m_is_named():
    """By 5.3 of its published sigmas; each fix that fitted half began the count anew, and it took 12 s (mission 1240499)."""
    mission = Mission(1240499)
    scenario = parse_scenario(mission.drawn, mission.label)
    judge = Judge(Setting(scenario, mission.course.heal_s, mission.course.end_s))
    watched(scenario, mission.seed, lambda moment: judge(moment) or moment.time_s > 24.0)
    assert judge.violations == []
