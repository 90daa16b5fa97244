"""Vehicles flown by another program, as seen on their ground-station links."""

from __future__ import annotations

import asyncio
import socket
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from radron.agent.errors import VehicleError
from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth
from radron.sim.vehicle.px4.config import Px4Config
from radron.sim.vehicle.px4.fleet import Px4Fleet
from radron.sim.vehicle.px4.ground_station import GroundStation
from radron.sim.world.localization import Localization, LocalizationTruth

RECORDINGS = Path(__file__).parents[2] / "contract" / "recordings"
sys.path.append(str(RECORDINGS))

from extract_links import Packet, packets  # noqa: E402

PLACES = np.array([[1.0, 2.0, 0.0], [20.0, -5.0, 0.0]])
STEP_S = 0.01
DISARMED, ARMED_OFFBOARD = 0x1D, 0x91
OFFBOARD = 0x60000


async def until(condition: Callable[[], bool], within_s: float = 5.0) -> None:
    async with asyncio.timeout(within_s):
        while not condition():
            await asyncio.sleep(0.005)


class Vehicle:
    """Sends a test's messages; system id 2."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(address)
        self._socket.settimeout(5.0)
        self._mavlink = mavlink.MAVLink(None, 2, 1)

    def send(self, message: mavlink.MAVLink_message) -> None:
        self._socket.send(message.pack(self._mavlink))

    def heartbeat(self, base_mode: int, status: int = 3) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(2, 12, base_mode, OFFBOARD, status, 3))

    def position(self, north: float, east: float, down: float) -> None:
        self.send(mavlink.MAVLink_local_position_ned_message(0, north, east, down, 1.0, 2.0, -3.0))

    def hear(self) -> bytes:
        return self._socket.recv(1000)

    async def hear_first(self, kind: str) -> mavlink.MAVLink_message:
        """The first message of a kind that comes."""
        async with asyncio.timeout(5.0):
            while True:
                for message in mavlink.MAVLink(None).parse_buffer(await asyncio.to_thread(self.hear)):
                    if message.get_type() == kind:
                        return message


def test_positions_count_from_the_launch_place_and_axes_are_turned() -> None:
    async def course() -> None:
        station = GroundStation(PLACES, ("127.0.0.1", 0))
        await station.start()
        vehicle = Vehicle(station.address)
        try:
            assert station.position_m.tolist() == PLACES.tolist()
            vehicle.heartbeat(DISARMED)
            vehicle.position(100.0, 50.0, -7.0)
            vehicle.heartbeat(ARMED_OFFBOARD, status=4)
            vehicle.position(103.0, 54.0, -12.0)
            yaw_east = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))  # FRD in NED
            vehicle.send(mavlink.MAVLink_attitude_quaternion_message(0, *yaw_east, 0.0, 0.0, 0.0))
            await until(lambda: station.position_m[1, 2] > 1.0)
            assert station.position_m[1].tolist() == pytest.approx([24.0, -2.0, 5.0])
            assert station.velocity_mps[1].tolist() == pytest.approx([2.0, 1.0, 3.0])
            assert station.position_m[0].tolist() == PLACES[0].tolist()
            assert np.abs(station.quaternion(1)) == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)  # heading east
            report = station.reports()[1]
            assert (report.mode, report.armed, report.failsafe) == ("offboard", True, False)
            vehicle.heartbeat(ARMED_OFFBOARD, status=5)
            await until(lambda: station.reports()[1].failsafe)
            vehicle.heartbeat(DISARMED)  # landed at another place: the launch place is unchanged
            vehicle.position(101.0, 50.0, -7.0)
            await until(lambda: station.position_m[1, 2] < 1.0)
            assert station.position_m[1].tolist() == pytest.approx([20.0, -4.0, 0.0])
            parser = mavlink.MAVLink(None)
            heard = await asyncio.to_thread(vehicle.hear)
            assert parser.parse_buffer(heard)[0].type == mavlink.MAV_TYPE_GCS
        finally:
            station.close()

    asyncio.run(course())


def test_it_sees_emulated_vehicles_as_they_are() -> None:
    async def course() -> None:
        rng = np.random.default_rng(1)
        headings = np.array([0.3, -2.0])
        motion = Multirotors(MultirotorTruth(gust_mps2=0.0), PLACES, headings, STEP_S, rng)
        error = Localization(LocalizationTruth(yaw_deg=0.0, tilt_deg=0.0), 2, STEP_S, rng)
        station = GroundStation(PLACES, ("127.0.0.1", 0))
        await station.start()
        links = [Px4Config(onboard=("127.0.0.1", 9), ground_station=station.address) for _ in PLACES]
        fleet = Px4Fleet(links, motion, error, STEP_S, rng)
        await fleet.start()
        try:
            for _ in range(300):
                fleet.step()
                await asyncio.sleep(0.0)
            await until(lambda: {report.mode for report in station.reports()} != {"unknown"})
            for drone in range(2):
                assert np.abs(np.dot(station.quaternion(drone), motion.quaternion(drone))) == pytest.approx(1.0, abs=1e-4)
            assert station.position_m == pytest.approx(motion.position_m, abs=0.5)  # by the vehicles' own estimates
            assert [report.mode for report in station.reports()] == [report.mode for report in fleet.reports()]
        finally:
            fleet.close()
            station.close()

    asyncio.run(course())


@contextmanager
def links(station: GroundStation) -> Iterator[dict[int, socket.socket]]:
    """Sockets of vehicles 1 and 2."""
    sockets = {system: socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for system in (1, 2)}
    try:
        for each in sockets.values():
            each.connect(station.address)
            each.settimeout(5.0)
        yield sockets
    finally:
        for each in sockets.values():
            each.close()


def heartbeat(packet: Packet) -> mavlink.MAVLink_heartbeat_message:
    return mavlink.MAVLink(None).decode(bytearray(packet.data))


async def settled() -> None:
    """Messages sent over loopback are read."""
    for _ in range(3):
        await asyncio.sleep(0.0)


def test_heartbeats_of_others_on_a_vehicles_link_do_not_count() -> None:
    recorded = list(packets(RECORDINGS / "two_vehicles.tlog.xz"))
    foreign = {packet.source for packet in recorded} - {(1, 1), (2, 1)}
    assert foreign == {(1, 195), (255, 190)}  # both companions call themselves 1/195

    async def course() -> None:
        station = GroundStation(PLACES, ("127.0.0.1", 0))
        await station.start()
        said: dict[int, bool] = {}
        with links(station) as sockets:
            for packet in recorded:
                system, component = packet.source
                # The link of origin of these is unknown: each vehicle forwards its own companion's.
                for link in (sockets[system],) if component == 1 else sockets.values():
                    link.send(packet.data)
                await settled()
                if packet.number == mavlink.MAVLINK_MSG_ID_HEARTBEAT and component == 1:
                    said[system] = bool(heartbeat(packet).base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                for number, armed in said.items():
                    assert station.reports()[number - 1].armed is armed, packet
        assert [(report.mode, report.armed) for report in station.reports()] == [("offboard", True)] * 2
        station.close()

    asyncio.run(course())


def test_where_a_simulated_vehicle_truly_is_counts_and_not_what_it_believes() -> None:
    recorded = list(packets(RECORDINGS / "two_vehicles.tlog.xz"))
    parser = mavlink.MAVLink(None)
    truths = [parser.decode(bytearray(each.data)) for each in recorded if (each.source, each.number) == ((2, 1), 115)]
    first, last = truths[0], truths[-1]
    metres = 1e-7 * np.pi / 180.0 * 6_378_137.0
    north = (last.lat - first.lat) * metres * 0.9989  # the meridian's curvature at 50 degrees
    east = (last.lon - first.lon) * metres * np.cos(np.radians(first.lat * 1e-7)) * 1.002  # the prime vertical's
    up = (last.alt - first.alt) * 1e-3
    assert np.hypot(north, east) > 3.0
    assert up > 2.0

    async def course() -> None:
        station = GroundStation(PLACES, ("127.0.0.1", 0))
        await station.start()
        with links(station) as sockets:
            for packet in recorded:
                if packet.source[1] == 1:
                    sockets[packet.source[0]].send(packet.data)
                    await settled()
        assert [report.truth for report in station.reports()] == ["simulation"] * 2
        assert station.position_m[1] == pytest.approx(PLACES[1] + (east, north, up), abs=0.02)
        assert station.velocity_mps[1] == pytest.approx([last.vy * 0.01, last.vx * 0.01, -last.vz * 0.01])
        station.close()

    asyncio.run(course())


def test_it_asks_a_vehicle_for_the_true_state_and_can_take_its_satellites_away() -> None:
    async def course() -> None:
        station = GroundStation(PLACES, ("127.0.0.1", 0))
        await station.start()
        vehicle = Vehicle(station.address)
        try:
            vehicle.heartbeat(DISARMED)
            asked = await vehicle.hear_first("COMMAND_LONG")
            assert (asked.target_system, asked.target_component) == (2, 1)
            assert (asked.command, asked.param1, asked.param2) == (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 115.0, 40_000.0)
            assert station.reports()[1].truth == "estimate"  # as long as none comes
            for received, satellites in ((False, 0), (True, 10)):
                station.switch_satellites(1, received)
                heard = await vehicle.hear_first("PARAM_SET")
                assert (heard.target_system, heard.param_id, heard.param_type) == (2, "SIM_GPS_USED", 6)
                assert struct.pack("<f", heard.param_value) == struct.pack("<i", satellites)
        finally:
            station.close()

    asyncio.run(course())


def test_a_simulation_that_was_booted_again_is_asked_again_for_the_true_state() -> None:
    async def course() -> None:
        station = GroundStation(PLACES, ("127.0.0.1", 0))
        await station.start()
        vehicle = Vehicle(station.address)
        try:
            vehicle.heartbeat(DISARMED)
            await vehicle.hear_first("COMMAND_LONG")
            level = [1.0, 0.0, 0.0, 0.0]
            vehicle.send(mavlink.MAVLink_hil_state_quaternion_message(0, level, *[0.0] * 3, 473977420, 85455940, *[0] * 9))
            await until(lambda: station.reports()[1].truth == "simulation")
            asked = await vehicle.hear_first("COMMAND_LONG")  # nothing comes any more
            assert (asked.command, asked.param1) == (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 115.0)
        finally:
            station.close()

    asyncio.run(course())


def test_a_failsafe_counts_from_the_text_that_announces_it() -> None:
    recorded = list(packets(RECORDINGS / "offboard_loss.tlog.xz"))

    async def course() -> None:
        station = GroundStation(PLACES, ("127.0.0.1", 0))
        await station.start()
        changes = [(0.0, False)]
        with links(station) as sockets:
            for packet in recorded:
                sockets[1].send(packet.data)
                await settled()
                failsafe = station.reports()[0].failsafe
                if failsafe is not changes[-1][1]:
                    changes.append(((packet.stamp_us - recorded[0].stamp_us) * 1e-6, failsafe))
        station.close()
        (_, (since_s, failsafe)) = changes  # once, and for good
        assert failsafe
        heartbeats = [each for each in recorded if (each.number, each.source) == (0, (1, 1))]
        shown = next(each for each in heartbeats if heartbeat(each).system_status == mavlink.MAV_STATE_CRITICAL)
        assert since_s < (shown.stamp_us - recorded[0].stamp_us) * 1e-6 - 0.3

    asyncio.run(course())


def test_a_port_in_use_is_one_line() -> None:
    async def course() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(("127.0.0.1", 0))
            port = taken.getsockname()[1]
            with pytest.raises(VehicleError, match=f"ground station: UDP 127.0.0.1:{port}: Address already in use"):
                await GroundStation(PLACES, ("127.0.0.1", port)).start()

    asyncio.run(course())
