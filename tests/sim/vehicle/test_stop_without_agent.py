"""How far a vehicle flies from its last setpoint on, in seconds of its velocity (docs/design/separation.md)."""

import numpy as np
import pytest

from radron.agent.vehicle.interface import FlightMode, Request, Setpoint, VehicleCommand
from radron.sim.vehicle.autopilot import Autopilot
from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth, Setpoints

STEP_S = 0.05
NOWHERE = np.zeros((1, 3))


def stop_s(mode, speed_mps):
    """The farthest place ahead of the last setpoint's, over the velocity there."""
    autopilot = Autopilot((0.0, 0.0, 0.0), 0.0, STEP_S, without_setpoints=mode)
    vehicle = Multirotors(MultirotorTruth(gust_mps2=0.0), np.zeros((1, 3)), np.zeros(1), STEP_S, np.random.default_rng(1))

    def step(command):
        autopilot.command(command)
        target = autopilot.target
        vectors = (np.array([vector]) for vector in (target.position, target.velocity, target.acceleration))
        setpoints = Setpoints(*vectors, np.array([target.yaw]), np.array([target.yaw_rate]))
        vehicle.step(setpoints, np.array([autopilot.grounded]), NOWHERE, NOWHERE)
        place = vehicle.position_m[0]
        autopilot.step(tuple(place), place[2], tuple(vehicle.velocity_mps[0]))
        return place[0]

    for _ in range(240):
        step(VehicleCommand(Request.TAKEOFF, takeoff_height_m=3.0))
    for count in range(160):
        time_s, ramp_s = count * STEP_S, 0.5 * speed_mps
        pulls, far_s = time_s < ramp_s, max(0.0, time_s - ramp_s)
        along_m = min(time_s, ramp_s) ** 2 + far_s * speed_mps
        velocity, acceleration = (min(speed_mps, 2.0 * time_s), 0.0, 0.0), (2.0 * pulls, 0.0, 0.0)
        last_m = step(VehicleCommand(Request.OFFBOARD, Setpoint((along_m, 0.0, 3.0), velocity, acceleration, 0.0, 0.0)))
    last_mps = vehicle.velocity_mps[0, 0]
    return max(step(VehicleCommand(Request.OFFBOARD)) - last_m for _ in range(120)) / last_mps


@pytest.mark.parametrize(
    ("mode", "speed_mps", "seconds"),
    [
        (FlightMode.RETURN, 3.0, 1.5),
        (FlightMode.RETURN, 6.5, 1.8),
        (FlightMode.RETURN, 8.0, 1.9),
        (FlightMode.LAND, 6.5, 2.0),
        (FlightMode.LAND, 8.0, 2.0),
        (FlightMode.HOLD, 3.0, 1.9),
        (FlightMode.HOLD, 6.5, 2.1),
        (FlightMode.HOLD, 8.0, 2.2),
    ],
)
def test_way_to_the_stop_without_an_agent(mode, speed_mps, seconds):
    """The peers keep 0.5 to 2 s of its velocity free, 2.3 s for a hold."""
    assert stop_s(mode, speed_mps) == pytest.approx(seconds, abs=0.07)
