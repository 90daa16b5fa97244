from itertools import pairwise
from math import pi

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.vehicle.interface import FlightMode, Request, Setpoint, VehicleCommand
from radron.sim.scenario import load_scenario
from radron.sim.vehicle.autopilot import Autopilot, autopilots
from radron.sim.vehicle.guidance import Reframing, return_height_m

STEP_S = 0.05
SETPOINT = Setpoint((3.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)
FAR = replace(SETPOINT, position_m=(12.0, 0.0, 3.0))


def run(autopilot, seconds, command=None):
    """The vehicle is exactly where its target is."""
    for _ in range(round(seconds / STEP_S)):
        if command is not None:
            autopilot.command(command)
        autopilot.step(autopilot.target.position)


def airborne(**values):
    autopilot = Autopilot((0.0, 0.0, 0.0), 0.0, STEP_S, **values)
    run(autopilot, 6.0, VehicleCommand(Request.TAKEOFF, takeoff_height_m=3.0))
    assert autopilot.in_air
    return autopilot


def test_takeoff_ends_in_hold_at_height():
    autopilot = airborne()
    assert autopilot.mode is FlightMode.HOLD
    assert 2.6 < autopilot.target.position[2] <= 3.0


def test_does_not_move_before_armed():
    autopilot = Autopilot((0.0, 0.0, 0.0), 0.0, STEP_S)
    run(autopilot, 2.0, VehicleCommand(Request.OFFBOARD, SETPOINT))
    assert autopilot.grounded
    assert autopilot.target.position == (0.0, 0.0, 0.0)


def test_follows_setpoints_and_returns_when_they_stop():
    autopilot = airborne()
    run(autopilot, 1.0, VehicleCommand(Request.OFFBOARD, SETPOINT))
    assert autopilot.mode is FlightMode.OFFBOARD
    assert autopilot.target.position == SETPOINT.position_m
    run(autopilot, 0.9)
    assert autopilot.mode is FlightMode.OFFBOARD
    run(autopilot, 0.2)
    assert autopilot.mode is FlightMode.RETURN
    assert autopilot.failsafe


def test_without_a_home_it_lands_where_it_is_when_setpoints_stop():
    """A PX4 without satellites has none: a simulated one returned, through the layers of others that climbed."""
    autopilot = airborne(has_home=False)
    run(autopilot, 1.0, VehicleCommand(Request.OFFBOARD, SETPOINT))
    run(autopilot, 1.2)
    assert (autopilot.mode, autopilot.failsafe) == (FlightMode.LAND, True)
    run(autopilot, 20.0)
    assert not autopilot.armed
    assert autopilot.target.position[:2] == SETPOINT.position_m[:2]


def test_without_setpoints_it_holds_where_it_stops_if_that_is_set():
    autopilot = airborne(without_setpoints=FlightMode.HOLD)
    run(autopilot, 1.0, VehicleCommand(Request.OFFBOARD, SETPOINT))
    run(autopilot, 60.0)
    assert (autopilot.mode, autopilot.failsafe, autopilot.armed) == (FlightMode.HOLD, True, True)
    assert autopilot.target.position[:2] == SETPOINT.position_m[:2]
    run(autopilot, 0.1, VehicleCommand(Request.OFFBOARD, SETPOINT))
    assert (autopilot.mode, autopilot.failsafe) == (FlightMode.OFFBOARD, False)


@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.RETURN, FlightMode.LAND])
def test_a_mode_that_is_asked_for_while_a_failsafe_flies_it_ends_the_failsafe(mode):
    autopilot = airborne(without_setpoints=mode)
    run(autopilot, 1.0, VehicleCommand(Request.OFFBOARD, SETPOINT))
    run(autopilot, 1.2)
    assert (autopilot.mode, autopilot.failsafe) == (mode, True)
    run(autopilot, 0.5, VehicleCommand(Request[mode.name]))
    assert (autopilot.mode, autopilot.failsafe) == (mode, False)


@pytest.mark.parametrize("agent_lost", ["return", "hold", "land"])
def test_without_setpoints_a_vehicle_does_what_its_mission_says(agent_lost):
    mission = load_scenario("paper-demo").mission
    mission = replace(mission, safety=replace(mission.safety, agent_lost=agent_lost))
    for autopilot in autopilots(mission, [(0.0, 0.0, 0.0)] * 3, np.zeros(3), STEP_S):
        run(autopilot, 6.0, VehicleCommand(Request.TAKEOFF, takeoff_height_m=3.0))
        run(autopilot, 1.0, VehicleCommand(Request.OFFBOARD, SETPOINT))
        run(autopilot, 1.2)
        assert autopilot.mode == agent_lost


def test_a_return_is_one_until_it_is_down():
    autopilot, heights = airborne(), []
    run(autopilot, 0.5, VehicleCommand(Request.OFFBOARD, FAR))
    for _ in range(200):
        run(autopilot, 0.5)
        if not autopilot.armed:
            break
        assert autopilot.mode in (FlightMode.OFFBOARD, FlightMode.RETURN)
        heights.append(autopilot.target.position[2])
    assert max(heights) > 9.0
    assert heights[-1] < 0.5
    assert not autopilot.armed


def test_setpoints_end_a_return_that_comes_down_over_home():
    autopilot = airborne()
    run(autopilot, 0.5, VehicleCommand(Request.OFFBOARD, FAR))
    run(autopilot, 12.0)
    while autopilot.target.position[2] > 1.0:
        run(autopilot, 0.5)
    assert (autopilot.mode, autopilot.failsafe) == (FlightMode.RETURN, True)
    run(autopilot, 1.0, VehicleCommand(Request.OFFBOARD, SETPOINT))
    assert (autopilot.mode, autopilot.target.position) == (FlightMode.OFFBOARD, SETPOINT.position_m)


def test_resumed_stream_takes_it_back_to_offboard():
    autopilot = airborne()
    run(autopilot, 0.5, VehicleCommand(Request.OFFBOARD, SETPOINT))
    run(autopilot, 1.5)
    run(autopilot, 0.1, VehicleCommand(Request.OFFBOARD, SETPOINT))
    assert autopilot.mode is FlightMode.OFFBOARD
    assert not autopilot.failsafe


def test_return_lands_at_home_and_disarms():
    autopilot = airborne()
    run(autopilot, 0.5, VehicleCommand(Request.OFFBOARD, SETPOINT))
    run(autopilot, 60.0, VehicleCommand(Request.RETURN))
    x, y, z = autopilot.target.position
    assert not autopilot.armed
    assert (abs(x), abs(y)) < (0.4, 0.4)
    assert z < 0.3


@pytest.mark.parametrize(
    ("far_m", "height_m", "expected_m"), [(12.0, 3.0, 10.0), (8.0, 3.0, 8.0), (8.0, 9.0, 9.0), (1.0, 1.5, 2.0)]
)
def test_a_return_is_lower_near_home(far_m, height_m, expected_m):
    """PX4's is: nearer than RTL_MIN_DIST no higher than a cone about home (RTL_CONE_ANG), and never lower than it is."""
    autopilot, heights = airborne(), []
    run(autopilot, 0.5, VehicleCommand(Request.OFFBOARD, replace(SETPOINT, position_m=(far_m, 0.0, height_m))))
    for _ in range(40):
        run(autopilot, 0.5, VehicleCommand(Request.RETURN))
        heights.append(autopilot.target.position[2])
    assert max(heights) == pytest.approx(expected_m)


def test_the_cone_about_home_is_given_by_its_half_angle():
    """As PX4 defines RTL_CONE_ANG: the smaller it is, the higher is a return from the same distance."""
    assert return_height_m(20.0, 6.0, angle_deg=30.0) == pytest.approx(6.0 * 3.0**0.5)
    assert return_height_m(20.0, 6.0, angle_deg=60.0) == pytest.approx(6.0 / 3.0**0.5)
    assert return_height_m(20.0, 6.0, within_m=5.0) == 20.0


def test_land_here():
    autopilot = airborne()
    run(autopilot, 0.5, VehicleCommand(Request.OFFBOARD, SETPOINT))
    run(autopilot, 20.0, VehicleCommand(Request.LAND))
    assert not autopilot.armed
    assert autopilot.target.position[:2] == SETPOINT.position_m[:2]


def test_release_commands_nothing():
    autopilot = airborne()
    run(autopilot, 1.0, VehicleCommand(Request.RELEASE))
    assert autopilot.mode is FlightMode.HOLD


def test_a_frame_that_jumps_leaves_target_and_home_where_they_are_in_the_world():
    """The new frame is turned by a quarter to the right and lies 10 m further east: points east of its origin are then north."""
    autopilot = airborne()
    run(autopilot, 0.5, VehicleCommand(Request.OFFBOARD, SETPOINT))
    jump = Reframing(pi / 2.0, (0.0, -10.0, 0.5))
    autopilot.reframe(jump)
    assert autopilot.target.position == pytest.approx((0.0, -7.0, 3.5))
    assert autopilot.target.yaw == pytest.approx(pi / 2.0)
    run(autopilot, 60.0, VehicleCommand(Request.RETURN))
    assert not autopilot.armed
    assert autopilot.target.position[:2] == pytest.approx((0.0, -10.0), abs=0.3)


def test_a_human_pilot_who_gives_a_vehicle_back_that_comes_down_lets_it_land():
    """Before, the vehicle held at 0.6 m, armed, for good."""
    autopilot = airborne()
    autopilot.take_over(FlightMode.RETURN)
    run(autopilot, 1.0)
    while autopilot.target.position[2] > 0.6:
        run(autopilot, STEP_S)
    autopilot.give_back()
    assert autopilot.mode is FlightMode.RETURN
    run(autopilot, 5.0)
    assert not autopilot.armed


def test_a_human_pilot_who_gives_a_vehicle_back_that_is_on_its_way_home_leaves_it_in_hold():
    autopilot = airborne()
    run(autopilot, 1.0, VehicleCommand(Request.OFFBOARD, FAR))
    autopilot.take_over(FlightMode.RETURN)
    run(autopilot, 1.0)
    autopilot.give_back()
    assert autopilot.mode is FlightMode.HOLD


def braked(mode):
    """From 5 m/s at (12, 1); the way north of a vehicle that is exactly where its target is."""
    autopilot = airborne()
    autopilot.step((12.0, 1.0, 3.0), velocity=(0.0, 5.0, 0.0))
    autopilot.take_over(mode)
    way = [autopilot.target]
    for _ in range(round(8.0 / STEP_S)):
        autopilot.step(autopilot.target.position)
        way.append(autopilot.target)
    return way


@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.MANUAL, FlightMode.LAND])
def test_a_vehicle_that_is_stopped_comes_to_rest_ahead_and_does_not_fly_back(mode):
    """By PX4's own rule, v (v / (2 MPC_ACC_HOR) + 0.6 s): 7.2 m from 5 m/s. How far a vehicle gets: ``test_braking``."""
    way = braked(mode)
    north = [target.position[1] for target in way]
    assert north == sorted(north)
    assert way[-1].position[:2] == pytest.approx((12.0, 8.17), abs=0.1)
    assert way[1].velocity[1] == pytest.approx(5.0, abs=0.1)  # without a jerk
    assert way[-1].velocity[:2] == pytest.approx((0.0, 0.0), abs=0.1)


def test_a_return_begins_where_the_vehicle_is():
    """The vehicle brakes at once, and returns while climbing."""
    north = [target.position[1] for target in braked(FlightMode.RETURN)]
    assert max(north) == pytest.approx(1.0 + 5.0**2 / (2.0 * 3.0), abs=0.3)
    assert north[round(4.0 / STEP_S)] < max(north) - 1.0


def test_a_vehicle_that_brakes_while_its_frame_jumps_comes_to_rest_at_the_same_place():
    autopilot = airborne()
    autopilot.step((3.0, 1.0, 3.0), velocity=(0.0, 5.0, 0.0))
    autopilot.take_over(FlightMode.HOLD)
    run(autopilot, 0.5)
    autopilot.reframe(Reframing(0.5 * pi, (10.0, 0.0, 0.0)))
    run(autopilot, 8.0)
    assert autopilot.target.position[:2] == pytest.approx((10.0 - 8.17, 3.0), abs=0.1)


def test_a_landing_from_high_up_slows_down_near_the_ground():
    autopilot, heights = airborne(), []
    run(autopilot, 0.5, VehicleCommand(Request.OFFBOARD, replace(SETPOINT, position_m=(3.0, 0.0, 20.0))))
    for _ in range(60):
        run(autopilot, 0.5, VehicleCommand(Request.LAND))
        heights.append(autopilot.target.position[2])
    fell = {height: height - after for height, after in pairwise(heights)}
    assert [fall for height, fall in fell.items() if height > 8.0] == pytest.approx([0.75] * 16, abs=0.01)
    assert [fall for height, fall in fell.items() if 0.5 < height < 3.5] == pytest.approx([0.35] * 9, abs=0.01)


def test_one_that_does_not_know_its_position_comes_down_slowly_all_the_way():
    autopilot = airborne()
    run(autopilot, 0.5, VehicleCommand(Request.OFFBOARD, replace(SETPOINT, position_m=(3.0, 0.0, 20.0))))
    autopilot.knows_position = False
    run(autopilot, 10.0)
    assert autopilot.mode is FlightMode.LAND
    assert autopilot.target.position[2] == pytest.approx(20.0 - 10.0 * 0.7, abs=0.1)
