"""The driver flies an emulated PX4 from the launch place and back, by MAVLink only."""

import asyncio
import time
from math import dist, hypot, pi

import pytest

from radron.agent.vehicle.interface import FlightMode, LaunchPlace, Request, VehicleCommand
from support.px4.sky import STAY, TAKEOFF, Sky, hover, ready, sky


async def airborne(flight: Sky) -> None:
    await ready(flight)
    await flight.fly(TAKEOFF, lambda: flight.state.in_air and flight.state.mode is FlightMode.HOLD, timeout_s=15.0)


def near(flight: Sky, *place_m: float, within_m: float = 1.0) -> bool:
    return dist(flight.state.position_m, place_m) < within_m


def test_a_flight_from_takeoff_to_landing() -> None:
    async def scenario() -> None:
        async with sky() as flight:
            await ready(flight)
            assert {finding.verdict for finding in await flight.vehicle.findings()} == {"ok"}
            assert hypot(*flight.state.position_m) < 0.5
            assert not flight.state.armed
            await flight.fly(TAKEOFF, lambda: flight.state.in_air and flight.state.mode is FlightMode.HOLD, timeout_s=15.0)
            assert abs(flight.state.position_m[2] - 4.0) < 1.0
            assert abs(flight.state.height_m - 4.0) < 1.0

            there = hover(6.0, -3.0, 5.0, yaw_rad=pi / 2)
            await flight.fly(there, lambda: near(flight, 6.0, -3.0, 5.0))
            assert flight.state.mode is FlightMode.OFFBOARD
            assert flight.state.healthy
            assert (
                dist(flight.state.position_m[:2], flight.true_position_m[:2]) < 1.0
            )  # east and north are where they are in truth

            await flight.fly(VehicleCommand(Request.HOLD), lambda: flight.state.mode is FlightMode.HOLD)
            await flight.fly(there, lambda: flight.state.mode is FlightMode.OFFBOARD)
            await flight.fly(VehicleCommand(Request.LAND), lambda: flight.state.mode is FlightMode.LAND)
            await flight.fly(VehicleCommand(Request.LAND), lambda: not flight.state.armed, timeout_s=15.0)
            assert not flight.state.in_air
            assert flight.vehicle.counters["not_sent"] == 0
            begun_s = time.monotonic()
            await flight.vehicle.close()
            assert time.monotonic() - begun_s < 1.0

    asyncio.run(scenario())


@pytest.mark.slow
def test_setpoints_end_a_failsafe_but_not_the_flight_of_a_human_pilot() -> None:
    async def scenario() -> None:
        async with sky() as flight:
            await airborne(flight)
            here = hover(0.0, 0.0, 4.0)
            await flight.fly(here, lambda: flight.state.mode is FlightMode.OFFBOARD)
            await flight.wait(3.0)
            assert flight.state.mode is FlightMode.RETURN
            assert not flight.state.healthy
            assert any("failsafe" in problem for problem in flight.vehicle.problems)
            await flight.fly(here, lambda: flight.state.mode is FlightMode.OFFBOARD and flight.state.healthy)

            flight.face.commander.take_over()
            await flight.fly(here, lambda: flight.state.mode is FlightMode.MANUAL)
            since = len(flight.states)
            await flight.insist(here)
            assert {state.mode for state in flight.states[since:]} == {FlightMode.MANUAL}

    asyncio.run(scenario())


def test_an_agent_restarted_after_a_landing_elsewhere_stays_in_the_frame_of_the_launch() -> None:
    async def scenario() -> None:
        async with sky() as flight:
            await ready(flight)
            assert flight.vehicle.launch is not None  # preflight compares it with the mission's layout
            assert flight.vehicle.launch_to_keep is None
            await flight.fly(TAKEOFF, lambda: flight.state.in_air and flight.state.mode is FlightMode.HOLD, timeout_s=15.0)
            there, land = hover(6.0, -3.0, 4.0), VehicleCommand(Request.LAND)
            await flight.fly(there, lambda: near(flight, 6.0, -3.0, 4.0))
            await flight.fly(land, lambda: not flight.state.armed, timeout_s=20.0)
            kept = flight.vehicle.launch_to_keep
            for launch, place_m in ((kept, flight.true_position_m), (None, (0.0, 0.0, 0.0))):
                await flight.vehicle.close()
                flight.new_vehicle(launch)
                await flight.connect()
                await flight.fly(STAY, lambda: bool(flight.states) and not flight.vehicle.problems)
                assert dist(flight.state.position_m[:2], place_m[:2]) < 1.0

    asyncio.run(scenario())


def test_an_agent_restarted_in_flight_goes_on_in_the_same_frame() -> None:
    async def scenario() -> None:
        async with sky() as flight:
            await airborne(flight)
            there = hover(5.0, 2.0, 4.0)
            await flight.fly(there, lambda: near(flight, 5.0, 2.0, 4.0))
            launch = flight.vehicle.launch
            assert isinstance(launch, LaunchPlace)
            await flight.vehicle.close()

            flight.new_vehicle()  # a vehicle without any command so far
            await flight.connect()
            await flight.fly(STAY, lambda: any("launched" in problem for problem in flight.vehicle.problems))
            assert flight.states == []
            await flight.vehicle.close()

            flight.new_vehicle(launch)
            await flight.connect()
            await flight.fly(there, lambda: bool(flight.states))
            assert flight.vehicle.launch == launch
            assert flight.state.in_air
            await flight.fly(there, lambda: flight.state.mode is FlightMode.OFFBOARD and near(flight, 5.0, 2.0, 4.0))

    asyncio.run(scenario())
