"""Faults of emulated vehicles in flight, as a live flight plays them."""

import asyncio

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from radron.sim.faults.machines import Battery, Gust, HeadingReset, MotorFailure, PositionJump, Refusal, StreamLost
from support.px4.emulated import Flight

ACCEPTED, REJECTED = 0, 1
ARM, LAND, RETURN = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH


def flown(scenario):
    """Run a scenario with a vehicle that hovers at 5 m."""

    async def fly():
        async with Flight() as flight:
            await flight.airborne(5.0)
            await flight.run(2.0)
            await scenario(flight, flight.fleet)

    asyncio.run(fly())


def told(flight):
    """The level that it reports, in percent."""
    return flight.companion.last("SYS_STATUS").battery_remaining


def test_a_gust_pushes_it_aside_and_lets_it_come_back():
    async def scenario(flight, fleet):
        gust, place = Gust(at_s=0.0, acceleration_mps2=4.0), flight.position.copy()
        fleet.begin_fault(0, gust)
        await flight.run(2.0)
        away_m = float(np.hypot(*(flight.position - place)[:2]))
        assert away_m > 0.5
        fleet.end_fault(0, gust)
        await flight.run(8.0)
        assert float(np.hypot(*(flight.position - place)[:2])) < 0.5 * away_m

    flown(scenario)


def test_without_a_motor_it_comes_down_and_never_flies_again():
    async def scenario(flight, fleet):
        fleet.begin_fault(0, MotorFailure(at_s=0.0, descent_mps=3.0))
        await flight.run(1.0)
        assert flight.report.failsafe
        await flight.run(3.0)
        assert flight.position[2] == pytest.approx(0.0, abs=0.05)
        await flight.until(lambda: not flight.report.armed, 40.0)
        assert await flight.ask(ARM, 1.0, 0.0) == [REJECTED]
        assert not flight.report.in_air

    flown(scenario)


def test_a_low_battery_is_reported_drains_and_sends_it_home():
    async def scenario(flight, fleet):
        fleet.begin_fault(0, Battery(at_s=0.0, level=0.09, drain_ps=0.004))
        await flight.run(2.0)
        assert told(flight) == pytest.approx(8.0, abs=0.6)
        fleet.end_fault(0, Battery(at_s=0.0, level=0.09, drain_ps=0.004))
        fleet.begin_fault(0, Battery(at_s=0.0, level=0.065, drain_ps=0.0))
        await flight.until(lambda: flight.report.mode == "return", 8.0)
        assert flight.report.failsafe

    flown(scenario)


def test_an_empty_battery_brings_it_down():
    async def scenario(flight, fleet):
        fleet.begin_fault(0, Battery(at_s=0.0, level=0.02, drain_ps=0.1, acts=False))
        await flight.until(lambda: flight.position[2] < 0.05, 10.0)

    flown(scenario)


def test_one_whose_autopilot_only_warns_flies_on_and_reacts_again_when_it_is_over():
    async def scenario(flight, fleet):
        battery, parameters = Battery(at_s=0.0, level=0.04, drain_ps=0.0, acts=False), fleet.faces[0].parameters
        action = parameters["COM_LOW_BAT_ACT"]
        fleet.begin_fault(0, battery)
        await flight.run(12.0)
        assert flight.report.mode == "hold"
        assert not flight.report.failsafe
        fleet.end_fault(0, battery)
        assert parameters["COM_LOW_BAT_ACT"] == action != 0.0

    flown(scenario)


def test_a_battery_that_lies_is_well_afterwards():
    async def scenario(flight, fleet):
        before, battery = told(flight), Battery(at_s=0.0, level=0.3, lies=True)
        fleet.begin_fault(0, battery)
        await flight.run(2.0)
        assert told(flight) == pytest.approx(30.0, abs=1.0)
        fleet.end_fault(0, battery)
        await flight.run(2.0)
        assert told(flight) == pytest.approx(before, abs=2.0)
        assert flight.report.mode == "hold"

    flown(scenario)


def test_a_refusal_concerns_modes_and_arming_until_it_is_over():
    async def scenario(flight, fleet):
        refusal = Refusal(at_s=0.0)
        fleet.begin_fault(0, refusal)
        assert await flight.ask(RETURN) == [REJECTED]
        assert flight.report.mode == "hold"
        fleet.end_fault(0, refusal)
        assert await flight.ask(LAND) == [ACCEPTED]

    flown(scenario)


def test_a_reset_of_the_filter_moves_its_own_position_and_back():
    async def scenario(flight, fleet):
        def place():
            told = flight.companion.last("LOCAL_POSITION_NED")
            return np.array((told.x, told.y))

        jump, before, truth = PositionJump(at_s=0.0, jump_m=5.0, announced=True), place(), flight.position.copy()
        fleet.begin_fault(0, jump)
        await flight.run(0.2)
        assert np.hypot(*(place() - before)) == pytest.approx(5.0, abs=0.5)
        assert np.hypot(*(flight.position - truth)[:2]) < 0.5
        fleet.end_fault(0, jump)
        await flight.run(0.2)
        assert np.hypot(*(place() - before)) < 0.5

    flown(scenario)


def test_a_message_that_is_not_sent_comes_again_when_the_fault_is_over():
    async def scenario(flight, fleet):
        silent, again = (StreamLost(at_s=at_s, message="LOCAL_POSITION_NED") for at_s in (0.0, 1.0))

        def stamp_ms():
            return flight.companion.last("LOCAL_POSITION_NED").time_boot_ms

        fleet.begin_fault(0, silent)
        await flight.run(0.2)
        before = stamp_ms()
        await flight.run(1.0)
        assert stamp_ms() == before
        fleet.begin_fault(0, again)
        fleet.end_fault(0, silent)
        await flight.run(1.0)
        assert stamp_ms() == before  # until the last of them is over
        fleet.end_fault(0, again)
        await flight.run(1.0)
        assert stamp_ms() > before + 500

    flown(scenario)


def test_reset_of_the_heading_turns_the_attitude_and_moves_nothing():
    async def scenario(flight, fleet):
        def told():
            place, attitude = flight.companion.last("LOCAL_POSITION_NED"), flight.companion.last("ATTITUDE")
            return np.array((place.x, place.y)), attitude.yaw, flight.companion.last("ODOMETRY").reset_counter

        (place, yaw_rad, count), north_rad = told(), float(fleet._frames.yaw_rad[0])
        fleet.begin_fault(0, HeadingReset(at_s=0.0, turn_deg=10.0))
        await flight.run(0.04)
        after, turned_rad, _ = told()
        assert abs(turned_rad - yaw_rad) == pytest.approx(np.radians(10.0), abs=0.03)
        assert np.hypot(*(after - place)) < 0.1
        assert float(fleet._frames.yaw_rad[0]) == north_rad
        await flight.run(0.1)
        assert told()[2] == count + 1

    flown(scenario)
