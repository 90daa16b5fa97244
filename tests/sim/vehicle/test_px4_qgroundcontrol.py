"""Requests of QGroundControl to a vehicle at its connection (its InitialConnectStateMachine), on the ground-station link."""

import asyncio
import struct

import pytest
from pymavlink.dialects.v20 import common, development

from support.px4.emulated import Flight, int_bits

ACCEPTED, DENIED = 0, 2
AVAILABLE_MODES, COMPONENT_METADATA, PROTOCOL_VERSION = 435, 397, 300


class QGroundControl:
    """Its part of the link: heartbeats, requests, and what comes of them."""

    def __init__(self, flight):
        self.flight, self.link = flight, flight.station

    def beat(self):
        self.link.send(common.MAVLink_heartbeat_message(common.MAV_TYPE_GCS, common.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3))

    async def run(self, seconds=0.1):
        await self.flight.run(seconds, self.beat)

    async def request(self, number, detail=0.0):
        """Ask for a message; the command's result."""
        before_s = self.flight.fleet.time_s
        self.link.command(common.MAV_CMD_REQUEST_MESSAGE, float(number), detail, 0.0, 0.0, 0.0, 0.0, 0.0)
        await self.run()
        (ack,) = self.flight.heard("COMMAND_ACK", before_s + 1e-6, self.link)
        assert (ack.message.target_system, ack.message.target_component) == (255, 190)
        return ack.message.result

    async def answers(self, message, name):
        """Send a message, and receive messages of a kind."""
        before_s = self.flight.fleet.time_s
        self.link.send(message)
        await self.run()
        return [heard.message for heard in self.flight.heard(name, before_s + 1e-6, self.link)]


def connected(scenario):
    async def fly():
        async with Flight(station=True) as flight:
            flight.link = flight.station
            station = QGroundControl(flight)
            await station.run(2.0)
            await scenario(station)

    asyncio.run(fly())


def crc32part(data, crc):
    """As QGroundControl computes it, bit by bit."""
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def test_the_whole_sequence_is_answered():
    async def scenario(station):
        link = station.link
        beat = station.flight.last("HEARTBEAT", link)
        assert (beat.autopilot, beat.type) == (common.MAV_AUTOPILOT_PX4, common.MAV_TYPE_QUADROTOR)
        # version and capabilities: without them it would not ask for mission, fence and rally points
        assert await station.request(common.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == ACCEPTED
        version = station.flight.last("AUTOPILOT_VERSION", link)
        assert version.flight_sw_version >> 16 == 0x0111
        for capability in ("MISSION_INT", "COMMAND_INT", "MAVLINK2", "MISSION_FENCE", "MISSION_RALLY"):
            assert version.capabilities & getattr(common, f"MAV_PROTOCOL_CAPABILITY_{capability}"), capability
        assert not version.capabilities & common.MAV_PROTOCOL_CAPABILITY_FTP
        assert await station.request(AVAILABLE_MODES) == ACCEPTED
        assert await station.request(COMPONENT_METADATA) == DENIED  # continues without
        values = await station.answers(common.MAVLink_param_request_list_message(1, 1), "PARAM_VALUE")
        assert [value.param_index for value in values[1:]] == list(range(values[0].param_count))
        for kind in (common.MAV_MISSION_TYPE_MISSION, common.MAV_MISSION_TYPE_FENCE, common.MAV_MISSION_TYPE_RALLY):
            (count,) = await station.answers(common.MAVLink_mission_request_list_message(1, 1, kind), "MISSION_COUNT")
            assert (count.count, count.mission_type, count.target_system, count.target_component) == (0, kind, 255, 190)
            assert not await station.answers(common.MAVLink_mission_ack_message(1, 1, 0, kind), "MISSION_ACK")
        assert await station.request(common.MAVLINK_MSG_ID_HOME_POSITION) == ACCEPTED
        home, origin = station.flight.last("HOME_POSITION", link), station.flight.last("GPS_RAW_INT", link)
        assert abs(home.latitude - origin.lat) < 100  # 1e-7 degrees: 11 m

    connected(scenario)


def test_the_modes_are_told_with_the_numbers_of_the_heartbeat():
    async def scenario(station):
        mavlink = development.MAVLink(None)
        assert await station.request(AVAILABLE_MODES) == ACCEPTED
        modes = [mavlink.decode(bytearray(packet)) for packet in station.link.packets(AVAILABLE_MODES)]
        assert [mode.mode_index for mode in modes] == list(range(1, modes[0].number_modes + 1))
        by_number = {(mode.standard_mode, mode.custom_mode): mode for mode in modes}
        assert by_number[0, 0x6 << 16].mode_name == "Offboard"
        assert by_number[0, 0x3 << 24 | 0x4 << 16].mode_name == "Hold"
        assert by_number[development.MAV_STANDARD_MODE_LAND, 0x6 << 24 | 0x4 << 16].mode_name == ""
        beat = station.flight.last("HEARTBEAT", station.link)
        assert beat.custom_mode in {custom for _, custom in by_number}
        assert await station.request(AVAILABLE_MODES, 2.0) == ACCEPTED
        assert mavlink.decode(bytearray(station.link.packets(AVAILABLE_MODES)[-1])).mode_index == 2
        assert await station.request(AVAILABLE_MODES, 99.0) == DENIED

    connected(scenario)


def test_the_list_of_parameters_begins_with_a_hash_over_all_that_follow():
    async def scenario(station):
        values = await station.answers(common.MAVLink_param_request_list_message(1, 1), "PARAM_VALUE")
        assert [value.param_id for value in values].count("_HASH_CHECK") == 1
        told = struct.pack("<f", values[0].param_value)
        # as recorded from PX4: A_params_list
        assert (values[0].param_id, values[0].param_index, values[0].param_type) == ("_HASH_CHECK", 65_535, 5)
        crc = 0
        for value in values[1:]:
            crc = crc32part(value.param_id.encode() + struct.pack("<f", value.param_value), crc)
        assert struct.unpack("<I", told)[0] == crc
        # the hash back: it knows them already, and wants no more
        known = common.MAVLink_param_set_message(1, 1, b"_HASH_CHECK", values[0].param_value, 5)
        assert not await station.answers(known, "PARAM_VALUE")
        assert not station.flight.heard("PARAM_ERROR", 0.0, station.link)
        # a changed parameter changes it
        await station.answers(common.MAVLink_param_set_message(1, 1, b"NAV_RCL_ACT", int_bits(3), 6), "PARAM_VALUE")
        read = common.MAVLink_param_request_read_message(1, 1, b"_HASH_CHECK", -1)
        (again,) = await station.answers(read, "PARAM_VALUE")
        assert struct.pack("<f", again.param_value) != told

    connected(scenario)


def test_a_lost_parameter_is_asked_for_by_its_index():
    async def scenario(station):
        (value,) = await station.answers(common.MAVLink_param_request_read_message(1, 1, b"", 7), "PARAM_VALUE")
        assert value.param_index == 7

    connected(scenario)


@pytest.mark.parametrize(("count", "result"), [(3, common.MAV_MISSION_UNSUPPORTED), (0, common.MAV_MISSION_ACCEPTED)])
def test_an_uploaded_mission_is_refused_and_an_empty_one_is_what_there_is(count, result):
    async def scenario(station):
        (ack,) = await station.answers(common.MAVLink_mission_count_message(1, 1, count, 0), "MISSION_ACK")
        assert (ack.type, ack.mission_type) == (result, 0)
        (cleared,) = await station.answers(common.MAVLink_mission_clear_all_message(1, 1, 1), "MISSION_ACK")
        assert (cleared.type, cleared.mission_type) == (common.MAV_MISSION_ACCEPTED, 1)

    connected(scenario)


def test_older_ones_ask_for_the_protocols_version():
    async def scenario(station):
        assert await station.request(PROTOCOL_VERSION) == ACCEPTED
        (packet,) = station.link.packets(PROTOCOL_VERSION)
        payload = packet[10 : 10 + packet[1]].ljust(22, b"\0")
        assert struct.unpack("<HHH", payload[:6]) == (200, 100, 200)

    connected(scenario)


def test_the_streams_of_a_ground_station_come():
    async def scenario(station):
        before_s = station.flight.fleet.time_s
        await station.run(2.0)
        for name in (
            "HEARTBEAT",
            "ATTITUDE",
            "GLOBAL_POSITION_INT",
            "GPS_RAW_INT",
            "SYS_STATUS",
            "BATTERY_STATUS",
            "HOME_POSITION",
        ):
            assert station.flight.heard(name, before_s, station.link), name
        assert station.flight.heard("EXTENDED_SYS_STATE", before_s, station.link)

    connected(scenario)
