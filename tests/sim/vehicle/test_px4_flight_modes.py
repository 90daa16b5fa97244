"""Flight modes of the emulated PX4: takeoff, landing, return, offboard and failsafes, with a real PX4's times."""

import asyncio

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from support.px4.emulated import Flight, int_bits, param_set, position_target

ACCEPTED, REJECTED = 0, 1
SET_MODE, ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
LAND, RETURN, HOLD = mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, (1.0, 4.0, 3.0)
ON_GROUND, IN_AIR, TAKEOFF, LANDING = 1, 2, 3, 4


def flown(scenario, height_m=5.0, **options):
    """Run a scenario with a vehicle that has just taken off."""

    async def fly():
        async with Flight(quiet=True, **options) as flight:
            await flight.airborne(height_m)
            await scenario(flight)

    asyncio.run(fly())


def here(flight, east=0.0, north=0.0, up=0.0, **more):
    """A target so far from where the vehicle is now."""
    at = flight.position - flight.origin() + (east, north, up)
    return position_target((at[1], at[0], -at[2]), **more)


def landed_states(flight):
    """[(state, since_s)]"""
    found = []
    for heard in flight.heard("EXTENDED_SYS_STATE"):
        if not found or found[-1][0] != heard.message.landed_state:
            found.append((heard.message.landed_state, heard.time_s))
    return found


def shown_modes(flight):
    return [heard.message.custom_mode for heard in flight.heard("HEARTBEAT")]


def test_takeoff_and_landing_take_their_time_and_show_their_states():
    async def scenario(flight):
        armed_s = flight.heard("COMMAND_ACK")[-1].time_s
        up_s = next(since_s for state, since_s in landed_states(flight) if state == IN_AIR)
        assert 7.4 < up_s - armed_s < 9.1  # to 5 m
        assert flight.position[2] == pytest.approx(5.0, abs=0.5)
        await flight.run(3.0)
        assert await flight.ask(LAND) == [ACCEPTED]
        landing_s = flight.fleet.time_s
        await flight.until(lambda: not flight.report.armed, 40.0)
        assert 9.0 < flight.fleet.time_s - landing_s < 33.0
        await flight.run(1.0)
        states = landed_states(flight)
        assert [state for state, _ in states] == [ON_GROUND, TAKEOFF, IN_AIR, LANDING, ON_GROUND]
        assert 1.5 < states[1][1] - armed_s < 2.3
        disarmed_s = flight.fleet.time_s - 1.0
        assert disarmed_s - states[4][1] == pytest.approx(2.0, abs=0.4)
        assert flight.position[2] == pytest.approx(0.0, abs=0.01)
        assert {0x2040000, 0x3040000, 0x6040000} <= set(shown_modes(flight))
        assert flight.report.mode == "hold"  # the last mode in which it may be armed

    flown(scenario)


def test_an_armed_vehicle_that_does_nothing_disarms_after_eleven_seconds():
    async def fly():
        async with Flight(quiet=True) as flight:
            await flight.run(5.0)
            assert await flight.ask(ARM, 1.0, 0.0) == [ACCEPTED]
            assert await flight.until(lambda: not flight.report.armed, 15.0) == pytest.approx(11.1, abs=0.2)

    asyncio.run(fly())


@pytest.mark.slow
def test_return_climbs_first_goes_home_and_lands_there():
    async def scenario(flight):
        home = flight.position
        target = here(flight, east=15.0)
        await flight.offboard(target)
        await flight.run(10.0, lambda: flight.companion.send(target))
        before = flight.position
        assert await flight.ask(RETURN) == [ACCEPTED]
        await flight.until(lambda: flight.position[2] > 11.0, 20.0)
        assert np.hypot(*(flight.position - before)[:2]) < 1.0
        await flight.until(lambda: not flight.report.armed, 60.0)
        assert np.hypot(*(flight.position - home)[:2]) < 0.5
        assert max(-heard.message.z + flight.origin()[2] for heard in flight.heard("LOCAL_POSITION_NED")) > 11.5
        assert shown_modes(flight)[-2] == 0x5040000  # down to the ground

    flown(scenario, parameters={"RTL_RETURN_ALT": 12.0})


def test_offboard_without_setpoints_is_accepted_and_then_refused():
    async def scenario(flight):
        assert await flight.ask(SET_MODE, 1.0, 6.0, 0.0) == [ACCEPTED, REJECTED]
        assert flight.report.mode == "hold"
        await flight.offboard(here(flight))  # a single one is enough
        assert await flight.ask(SET_MODE, *HOLD) == [ACCEPTED, ACCEPTED]
        assert flight.report.mode == "hold"

    flown(scenario)


def test_a_slow_stream_holds_offboard_and_a_lost_one_returns_until_it_resumes():
    async def scenario(flight):
        target = here(flight, east=5.0)
        await flight.offboard(target)
        for _ in range(6):
            await flight.run(0.83)
            flight.companion.send(target)
            assert flight.report.mode == "offboard"
        await flight.run(0.02)
        lost_s = flight.fleet.time_s
        noticed_s = await flight.until(lambda: flight.report.failsafe, 3.0)
        assert noticed_s == pytest.approx(1.06, abs=0.06)
        assert flight.report.mode == "return"
        assert flight.fleet.time_s - lost_s == pytest.approx(1.06, abs=0.06)
        await flight.run(1.1)
        assert flight.last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL
        assert flight.last("HEARTBEAT").custom_mode == 0x5040000
        await flight.run(0.2, lambda: flight.companion.send(target))
        assert flight.report.mode == "offboard"
        assert not flight.report.failsafe
        assert flight.report.largest_gap_s == 0.0  # all were the same

    flown(scenario)


def test_after_a_failsafe_return_it_stands_disarmed_in_offboard_as_it_was_last_told():
    async def scenario(flight):
        await flight.offboard(here(flight))
        await flight.until(lambda: flight.report.mode == "return", 2.0)
        await flight.until(lambda: not flight.report.armed, 40.0)
        await flight.run(1.1)
        assert not flight.report.failsafe
        assert (flight.last("HEARTBEAT").base_mode, flight.last("HEARTBEAT").custom_mode) == (0x11, 0x60000)

    flown(scenario, height_m=3.0, parameters={"RTL_RETURN_ALT": 4.0})


def test_what_the_parameters_say_is_done_when_the_stream_is_lost():
    async def scenario(flight):
        await flight.offboard(here(flight))
        await flight.run(1.5)
        assert flight.report.mode == "land"

    flown(scenario, height_m=3.0, parameters={"COM_OBL_RC_ACT": 4})


@pytest.mark.slow
def test_a_lost_ground_station_is_minded_only_where_the_parameter_says_so():
    def beat(flight):
        return lambda: flight.companion.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))

    async def minded(flight):
        assert await flight.until(lambda: flight.report.failsafe, 20.0) == pytest.approx(12.1, abs=0.2)
        assert await flight.until(lambda: flight.report.mode == "return", 10.0) == pytest.approx(5.0, abs=0.2)
        await flight.run(0.2, beat(flight))
        assert flight.report.mode == "return"  # goes on until a mode is chosen
        assert await flight.ask(SET_MODE, *HOLD) == [ACCEPTED, ACCEPTED]
        await flight.run(0.1)
        assert flight.report.mode == "hold"
        assert not flight.report.failsafe

    async def fly(scenario, action):
        async with Flight(quiet=True) as flight:
            await flight.airborne(3.0)
            flight.companion.send(param_set("NAV_DLL_ACT", int_bits(action), mavlink.MAV_PARAM_TYPE_INT32))
            await flight.run(0.05, beat(flight))
            await scenario(flight)

    async def ignored(flight):
        await flight.run(14.0)
        assert flight.report.mode == "hold"
        assert not flight.report.failsafe

    asyncio.run(fly(minded, 2))
    asyncio.run(fly(ignored, 0))


def test_the_geofence_acts():
    async def scenario(flight):
        target = here(flight, east=20.0)
        await flight.offboard(target)
        await flight.until(lambda: flight.report.failsafe, 10.0, lambda: flight.companion.send(target))
        assert flight.position[0] == pytest.approx(10.0, abs=0.5)
        assert flight.report.mode == "hold"
        assert await flight.until(lambda: flight.report.mode == "return", 10.0) == pytest.approx(5.0, abs=0.2)

    flown(scenario, height_m=3.0, parameters={"GF_MAX_HOR_DIST": 10.0, "GF_ACTION": 3})


def test_disarming_in_the_air_needs_force_and_then_it_falls():
    async def scenario(flight):
        assert await flight.ask(ARM, 0.0, 0.0) == [REJECTED]
        assert flight.report.armed
        assert await flight.ask(ARM, 0.0, 21196.0) == [ACCEPTED]
        assert not flight.report.armed
        await flight.until(lambda: not flight.report.in_air, 8.0)
        assert flight.position[2] == 0.0

    flown(scenario)


def test_somebody_at_the_sticks_has_the_vehicle():
    async def scenario(flight):
        assert await flight.ask(SET_MODE, 1.0, 3.0, 0.0) == [ACCEPTED, REJECTED]  # sticks untouched
        target = here(flight, east=20.0)
        await flight.offboard(target)
        flight.fleet.faces[0].commander.take_over()
        await flight.run(3.0, lambda: flight.companion.send(target))
        assert flight.report.mode == "position"
        assert flight.last("HEARTBEAT").custom_mode == 0x30000
        assert flight.position[0] < 1.0

    flown(scenario, height_m=3.0)


def test_follows_a_circle_with_a_real_px4s_lag():
    rate, radius = 3.0 / 12.0, 12.0

    async def scenario(flight):
        centre = flight.position - (radius, 0.0, 0.0)
        ox, oy, oz = flight.origin()
        begin_s = flight.fleet.time_s

        def steer():
            angle = rate * (flight.fleet.time_s - begin_s)
            east, north = centre[0] + radius * np.cos(angle) - ox, centre[1] + radius * np.sin(angle) - oy
            velocity = (3.0 * np.cos(angle), -3.0 * np.sin(angle), 0.0)
            flight.companion.send(position_target((north, east, oz - 5.0), velocity))

        steer()
        await flight.offboard(here(flight))
        await flight.run(30.0, steer)
        places = []

        def note():
            steer()
            east, north = (flight.position - centre)[:2]
            behind = rate * (flight.fleet.time_s - begin_s) - np.arctan2(north, east)
            places.append((np.hypot(east, north), (behind + np.pi) % (2.0 * np.pi) - np.pi))

        await flight.run(12.0, note)
        flown_radius, behind = np.mean(places, axis=0)
        assert flown_radius == pytest.approx(12.0 + 1.07, abs=0.2)  # mean of four runs
        assert behind / rate == pytest.approx(0.40, abs=0.06)
        assert flight.report.mode == "offboard"
        assert not flight.report.failsafe

    flown(scenario)


def test_a_parameter_that_is_set_is_flown_with():
    """Half of 4 m is done after 1.5 s with a real PX4's MPC_XY_P of 0.95, after 1.2 s with 1.4."""

    async def half_of_a_jump_s(flight, north):
        target = here(flight, north=north)
        await flight.offboard(target)
        start = flight.position[1]
        await flight.until(lambda: abs(flight.position[1] - start) > 0.5 * abs(north), 5.0, lambda: flight.companion.send(target))
        spent_s = flight.fleet.time_s
        await flight.run(8.0, lambda: flight.companion.send(target))
        return spent_s

    async def scenario(flight):
        took_s = []
        for gain, north in ((0.95, 4.0), (1.4, -4.0)):
            flight.companion.send(param_set("MPC_XY_P", gain))
            await flight.run(0.05)
            begin_s = flight.fleet.time_s
            took_s.append(await half_of_a_jump_s(flight, north) - begin_s)
        assert took_s[0] == pytest.approx(1.5, abs=0.2)
        assert took_s[0] - took_s[1] == pytest.approx(0.3, abs=0.15)

    flown(scenario)


@pytest.mark.slow
def test_velocity_targets_lag_more_and_fly_too_small_a_circle():
    rate, radius = 3.0 / 12.0, 12.0

    async def scenario(flight):
        begin_s = flight.fleet.time_s

        def angle():
            return rate * (flight.fleet.time_s - begin_s)

        def steer():
            velocity = (3.0 * np.cos(angle()), -3.0 * np.sin(angle()), 0.0)
            flight.companion.send(position_target((0.0, 0.0, 0.0), velocity, mask=0b1101_1100_0111))

        steer()
        await flight.offboard(here(flight))
        await flight.run(25.0, steer)
        track, behind = [], []

        def note():
            steer()
            track.append(flight.position[:2])
            east, north = flight.motion.velocity_mps[0, :2]
            behind.append((angle() - np.arctan2(-east, north) + np.pi) % (2.0 * np.pi) - np.pi)

        await flight.run(26.0, note)
        across = np.ptp(np.array(track), axis=0)
        assert across / 2.0 == pytest.approx(radius - 2.6, abs=0.5)
        assert np.mean(behind) / rate == pytest.approx(1.4, abs=0.15)

    flown(scenario, height_m=3.0)
