"""Answers of the emulated PX4: acknowledgements, texts, parameters, clocks, and requests without an answer."""

import asyncio
import math
import struct

import pytest
from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.px4.config import Faults
from support.px4.emulated import Flight, int_bits, param_set, position_target

ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
SET_MODE, ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM


def on_the_ground(scenario, **options):
    """Run a scenario with a vehicle that is ready to arm."""

    async def fly():
        async with Flight(**options) as flight:
            await flight.run(5.0)
            await scenario(flight)

    asyncio.run(fly())


def texts(flight, since_s=0.0):
    """Chunks put together."""
    whole = {}
    for heard in flight.heard("STATUSTEXT", since_s, flight.station):
        key = heard.message.id or ("alone", len(whole))
        whole[key] = whole.get(key, "") + heard.message.text
    return list(whole.values())


def ground_station(flight):
    return lambda: flight.station.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))


def test_a_mode_change_is_acknowledged_twice_and_the_heartbeat_comes_later():
    async def scenario(flight):
        before_s = flight.fleet.time_s
        flight.companion.command(SET_MODE, 1.0, 4.0, 6.0)
        await flight.run(1.1)
        acks = flight.heard("COMMAND_ACK", before_s)
        assert [heard.message.result for heard in acks] == [ACCEPTED, ACCEPTED]
        assert acks[1].time_s - before_s <= 0.011
        shown = next(h for h in flight.heard("HEARTBEAT", before_s) if h.message.custom_mode == 0x6040000)
        assert shown.time_s - before_s <= 1.0
        assert shown.message.base_mode == 0x1D

    on_the_ground(scenario)


def test_arming_is_refused_at_first_and_works_within_4_s():
    async def fly():
        async with Flight(station=True) as flight:  # a second ago
            await flight.run(1.9, ground_station(flight))
            assert flight.last("HEARTBEAT").system_status == mavlink.MAV_STATE_UNINIT
            assert await flight.ask(ARM, 1.0, 0.0) == [REJECTED]
            assert not flight.report.armed
            await flight.run(1.0, ground_station(flight))
            assert await flight.ask(ARM, 1.0, 0.0) == [ACCEPTED]
            assert flight.report.armed
            await flight.run(1.1)
            beat = flight.last("HEARTBEAT")
            assert (beat.base_mode, beat.system_status) == (0x9D, mavlink.MAV_STATE_ACTIVE)
            return texts(flight)

    assert asyncio.run(fly())[:3] == [
        "Preflight Fail: heading estimate not stable",
        "Arming denied: Resolve system health failures first\t",
        "Armed by external command\t",
    ]


def test_a_vehicle_that_is_never_healthy_says_why():
    async def scenario(flight):
        await flight.run(1.0, ground_station(flight))
        assert await flight.ask(ARM, 1.0, 0.0) == [REJECTED]
        await flight.run(1.0)
        assert "Preflight Fail: Compass 0 fault" in texts(flight)
        assert not flight.last("SYS_STATUS").onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK

    on_the_ground(scenario, station=True, faults=Faults(unhealthy="Compass 0 fault"))


def test_offboard_needs_setpoints_for_arming_but_any_mode_is_accepted_on_the_ground():
    async def scenario(flight):
        assert await flight.ask(SET_MODE, 1.0, 6.0, 0.0) == [ACCEPTED, ACCEPTED]
        assert flight.report.mode == "offboard"
        assert await flight.ask(ARM, 1.0, 0.0) == [REJECTED]
        flight.companion.send(position_target((0.0, 0.0, 0.0)))
        assert await flight.ask(ARM, 1.0, 0.0) == [ACCEPTED]
        await flight.run(1.0)
        assert flight.last("HEARTBEAT").base_mode == 0x91

    on_the_ground(scenario)


def test_texts_go_to_ground_stations_only_in_chunks():
    async def scenario(flight):
        await flight.run(0.5, ground_station(flight))
        heard = [h.message for h in flight.heard("STATUSTEXT", link=flight.station)]
        assert [(len(message.text), message.id, message.chunk_seq) for message in heard] == [(43, 0, 0), (50, 1, 0), (46, 1, 1)]
        assert not flight.heard("STATUSTEXT")  # the companion is no ground station

    on_the_ground(scenario, station=True, faults=Faults(unhealthy=80 * "x"))


def test_unknown_commands_messages_and_parameters():
    async def scenario(flight):
        request = mavlink.MAV_CMD_REQUEST_MESSAGE
        assert await flight.ask(mavlink.MAV_CMD_DO_PARACHUTE, 1.0) == [UNSUPPORTED]
        assert await flight.ask(request, 11_000.0) == [DENIED]
        for number, name in ((148, "AUTOPILOT_VERSION"), (242, "HOME_POSITION"), (49, "GPS_GLOBAL_ORIGIN")):
            before_s = flight.fleet.time_s
            assert await flight.ask(request, float(number)) == [ACCEPTED]
            assert flight.heard(name, before_s + 1e-6), name
        flight.companion.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH_THING", -1))
        flight.companion.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 10_000))
        await flight.run(0.1)
        assert not flight.heard("PARAM_VALUE")
        errors = [heard.message for heard in flight.heard("PARAM_ERROR")]
        told = [(error.param_id, error.error, error.target_component) for error in errors]
        assert told == [("NO_SUCH_THING", 1, 190), ("", 1, 190)]

    on_the_ground(scenario)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, -1.0, 1e30])
def test_commands_with_numbers_of_nothing(number):
    async def scenario(flight):
        places = [number] * 7
        assert await flight.ask(mavlink.MAV_CMD_REQUEST_MESSAGE, *places) == [DENIED]
        assert await flight.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, *places) == [DENIED]
        assert await flight.ask(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, *places) == [ACCEPTED]
        assert await flight.ask(SET_MODE, *places) == [ACCEPTED, DENIED]
        assert await flight.ask(mavlink.MAV_CMD_INJECT_FAILURE, *places) == []
        assert await flight.ask(mavlink.MAV_CMD_EXTERNAL_POSITION_ESTIMATE, 0.0, 0.0, 0.0, 0.0, 47.0, 8.0, number) == (
            [ACCEPTED] if number == -1.0 or math.isnan(number) else [DENIED]  # the altitude may be left out
        )
        flight.companion.send(mavlink.MAVLink_set_gps_global_origin_message(1, 2_000_000_000, -(2**31), 2**31 - 1))
        await flight.run(0.1)
        assert flight.last("GLOBAL_POSITION_INT").alt < 1_000_000
        assert await flight.ask(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32.0, number) == [ACCEPTED]
        before_s = flight.fleet.time_s
        assert await flight.ask(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 32.0) == [ACCEPTED]
        (interval,) = flight.heard("MESSAGE_INTERVAL", before_s + 1e-6)
        assert interval.message.interval_us == -1

    on_the_ground(scenario)


def test_silence_for_the_wrong_target():
    async def scenario(flight):
        flight.companion.command(ARM, 1.0, 0.0, system=2)
        flight.companion.command(ARM, 1.0, 0.0, component=77)
        await flight.run(0.1)
        assert not flight.heard("COMMAND_ACK")
        assert not flight.report.armed

    on_the_ground(scenario)


def test_parameters_are_read_and_set_integers_by_their_bits():
    async def scenario(flight):
        flight.companion.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NAV_RCL_ACT", -1))
        await flight.run(0.05)
        value = flight.last("PARAM_VALUE")
        assert value.param_type == mavlink.MAV_PARAM_TYPE_INT32
        assert struct.unpack("<i", struct.pack("<f", value.param_value)) == (2,)
        flight.companion.send(param_set("NAV_RCL_ACT", int_bits(3), 6))
        flight.companion.send(param_set("RTL_RETURN_ALT", 12.5))
        flight.companion.send(param_set("RTL_TYPE", 1.0))  # of the wrong type
        await flight.run(0.05)
        answers = {h.message.param_id: h.message.param_value for h in flight.heard("PARAM_VALUE")}
        assert answers["RTL_RETURN_ALT"] == 12.5
        assert struct.unpack("<i", struct.pack("<f", answers["NAV_RCL_ACT"])) == (3,)
        assert "RTL_TYPE" not in answers
        assert [(h.message.param_id, h.message.error) for h in flight.heard("PARAM_ERROR")] == [("RTL_TYPE", 7)]

    on_the_ground(scenario)


def test_the_list_has_every_parameter_once():
    async def scenario(flight):
        flight.companion.send(mavlink.MAVLink_param_request_list_message(1, 1))
        await flight.run(0.1)
        values = [heard.message for heard in flight.heard("PARAM_VALUE")]
        assert values.pop(0).param_id == "_HASH_CHECK"
        assert sorted(value.param_index for value in values) == list(range(values[0].param_count))
        assert len({value.param_id for value in values}) == len(values) > 40

    on_the_ground(scenario)


def test_clocks_are_compared_both_ways():
    async def scenario(flight):
        flight.companion.send(mavlink.MAVLink_timesync_message(0, 123_456_789))
        flight.companion.send(mavlink.MAVLink_ping_message(5, 7, 0, 0))
        before_s = flight.fleet.time_s
        await flight.run(4.0)
        answers = [h.message for h in flight.heard("TIMESYNC") if h.message.tc1 != 0]
        assert [answer.ts1 for answer in answers] == [123_456_789]
        assert answers[0].tc1 * 1e-9 == pytest.approx(before_s, abs=0.1)
        requests = [h.message for h in flight.heard("TIMESYNC", before_s) if h.message.tc1 == 0]
        assert len(requests) == pytest.approx(40, abs=2)
        assert flight.last("PING").seq == 7
        assert flight.last("PING").target_system == 245

    on_the_ground(scenario)


def test_faults_of_the_link():
    async def fly():
        async with Flight(faults=Faults(boot_s=2.0)) as flight:
            await flight.run(1.5)
            assert not flight.companion.heard()
            await flight.run(1.5)
            assert flight.companion.heard()[0].message.get_type()
            assert flight.last("ATTITUDE").time_boot_ms == pytest.approx(2000, abs=30)
            flight.fleet.faces[0].cut_links(1.0)
            await flight.run(0.02)
            before = len(flight.companion.heard())
            assert await flight.ask(ARM, 1.0, 1.0) == []
            await flight.run(0.8)
            assert len(flight.companion.heard()) == before
            await flight.run(0.5)
            assert len(flight.companion.heard()) > before
        async with Flight(faults=Faults(silent=True)) as flight:
            await flight.run(2.0)
            assert not flight.companion.heard()

    asyncio.run(fly())


def test_garbage_is_counted_and_does_no_harm():
    async def scenario(flight):
        flight.companion._socket.sendto(b"GET / HTTP/1.0\r\n\r\n", flight.companion._vehicle)
        flight.companion._socket.sendto(b"\xfd\xff\x00\x00", flight.companion._vehicle)
        await flight.run(0.1)
        assert flight.fleet.faces[0].links[0].refused > 0
        answers = [await flight.ask(ARM, 1.0, 0.0) for _ in range(12)]  # some are lost in the broken frame's claimed length
        assert answers[-1] == [ACCEPTED]

    on_the_ground(scenario)
