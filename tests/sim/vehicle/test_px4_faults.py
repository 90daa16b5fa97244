"""Faults of the emulated PX4: somebody disarms it, one of its streams stops, its filter is reset."""

import asyncio

import numpy as np
import pytest
from emulated_px4 import Flight
from pymavlink.dialects.v20 import common as mavlink

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM


def test_somebody_disarms_it_once_its_heartbeat_has_shown_it_armed_and_only_once() -> None:
    async def fly() -> None:
        async with Flight(quiet=True) as flight:
            await flight.run(5.0)
            flight.fleet.disarm(0)
            assert await flight.ask(ARM, 1.0, 0.0) == [0]
            armed_s = flight.fleet.time_s
            await flight.until(lambda: not flight.report.armed, 2.0)
            flags = [heard.message.base_mode for heard in flight.heard("HEARTBEAT", armed_s)]
            assert any(flag & mavlink.MAV_MODE_FLAG_SAFETY_ARMED for flag in flags)
            assert await flight.ask(ARM, 1.0, 0.0) == [0]
            await flight.run(3.0)
            assert flight.report.armed

    asyncio.run(fly())


def test_a_stream_that_stops_and_comes_back() -> None:
    async def fly() -> None:
        async with Flight() as flight:
            await flight.run(1.0)
            flight.fleet.switch_stream(0, "ATTITUDE_QUATERNION", sent=False)
            await flight.run(0.1)
            off_s = flight.fleet.time_s
            await flight.run(1.0)
            assert flight.heard("ATTITUDE_QUATERNION", off_s) == []
            assert flight.heard("LOCAL_POSITION_NED", off_s)
            flight.fleet.switch_stream(0, "ATTITUDE_QUATERNION", sent=True)
            on_s = flight.fleet.time_s
            await flight.run(1.0)
            assert len(flight.heard("ATTITUDE_QUATERNION", on_s)) > 40

    asyncio.run(fly())


def test_a_filter_that_is_reset_tells_another_place_and_counts_it_and_the_vehicle_stays_where_it_is() -> None:
    async def fly() -> None:
        async with Flight() as flight:
            await flight.airborne(5.0)
            place, before, count = flight.position, flight.last("LOCAL_POSITION_NED"), flight.last("ODOMETRY").reset_counter
            flight.fleet.reset_filter(0, (3.0, -4.0, 0.0), 0.0)
            await flight.run(3.0)
            after = flight.last("LOCAL_POSITION_NED")
            assert np.hypot(after.x - before.x, after.y - before.y) == pytest.approx(5.0, abs=0.5)
            assert flight.last("ODOMETRY").reset_counter == count + 1
            assert np.linalg.norm(flight.position - place) < 0.5  # in hold, PX4 takes its resets into account

    asyncio.run(fly())
