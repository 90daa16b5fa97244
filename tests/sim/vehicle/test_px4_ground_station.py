"""Vehicles that others fly, as their ground-station links tell of them."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from agent.errors import VehicleError
from sim.localization import Localization, LocalizationTruth
from sim.vehicle.multirotor import Multirotors, MultirotorTruth
from sim.vehicle.px4.config import Px4Config
from sim.vehicle.px4.fleet import Px4Fleet
from sim.vehicle.px4.ground_station import GroundStation

PLACES = np.array([[1.0, 2.0, 0.0], [20.0, -5.0, 0.0]])
STEP_S = 0.01
DISARMED, ARMED_OFFBOARD = 0x1D, 0x91
OFFBOARD = 0x60000


async def until(condition: Callable[[], bool], within_s: float = 5.0) -> None:
    async with asyncio.timeout(within_s):
        while not condition():
            await asyncio.sleep(0.005)


class Vehicle:
    """Sends what a test says; system id 2."""

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
            vehicle.heartbeat(DISARMED)  # down again, elsewhere: the launch place is still where it was
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


def test_a_port_in_use_is_one_line() -> None:
    async def course() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(("127.0.0.1", 0))
            port = taken.getsockname()[1]
            with pytest.raises(VehicleError, match=f"ground station: UDP 127.0.0.1:{port}: Address already in use"):
                await GroundStation(PLACES, ("127.0.0.1", port)).start()

    asyncio.run(course())
