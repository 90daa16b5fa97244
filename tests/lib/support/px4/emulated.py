"""Emulated PX4s under the test's own clock, and a bare MAVLink station on their links."""

import asyncio
import contextlib
import socket
import struct
from math import isfinite
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth
from radron.sim.vehicle.px4.config import Px4Config
from radron.sim.vehicle.px4.fleet import Px4Fleet
from radron.sim.vehicle.px4.mavlink.streams import ONBOARD_HZ
from radron.sim.world.localization import Localization, LocalizationTruth

STEP_S = 0.01
UTC_NS = 1_767_225_600_000_000_000
PERFECT = LocalizationTruth(
    horizontal_m=0.0, vertical_m=0.0, velocity_mps=0.0, climb_mps=0.0, drift_m=0.0, height_m=0.0, yaw_deg=0.0, tilt_deg=0.0
)
NAN = float("nan")
AUTOPILOT = 1  # component; heartbeats of others are passed on
_LOOKED_AT = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
}


def new_fleet(configs, places=None, localization=PERFECT, gust_mps2=0.0, seed=1, **kwargs):
    """A fleet, and its true motion; the vehicles stand 10 m apart unless ``places`` says otherwise."""
    count = len(configs)
    places = [(10.0 * index, 0.0, 0.0) for index in range(count)] if places is None else places
    rng = np.random.default_rng(seed)
    motion = Multirotors(MultirotorTruth(gust_mps2=gust_mps2), np.array(places), np.zeros(count), STEP_S, rng)
    return Px4Fleet(configs, motion, Localization(localization, count, STEP_S, rng), STEP_S, rng, **kwargs), motion


class Heard(NamedTuple):
    time_s: float
    message: mavlink.MAVLink_message


class Companion:
    """An end of a link: a socket that hears one vehicle and answers it."""

    def __init__(self, system=245, component=190):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._mavlink = mavlink.MAVLink(self, system, component)
        self._vehicle = None
        self._datagrams = []

    @property
    def address(self):
        return self._socket.getsockname()

    def close(self):
        self._socket.close()

    def write(self, data):
        self._socket.sendto(data, self._vehicle)

    def send(self, message):
        self._mavlink.send(message)

    def command(self, number, *parameters, system=1, component=1):
        filled = [*parameters, *[NAN] * (7 - len(parameters))]
        self.send(mavlink.MAVLink_command_long_message(system, component, number, 0, *filled))

    def heard(self, name=None, since_s=0.0):
        """The vehicle's messages, of one kind if it is named; every datagram is one, decoded only when wanted."""
        number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}") if name else None
        return [
            Heard(time_s, self._mavlink.decode(bytearray(data)))
            for time_s, data in self._datagrams
            if time_s >= since_s and data[6] == AUTOPILOT and number in (None, int.from_bytes(data[7:10], "little"))
        ]

    def packets(self, number):
        """The vehicle's packets of one kind, for messages that this dialect lacks."""
        return [data for _, data in self._datagrams if data[6] == AUTOPILOT and int.from_bytes(data[7:10], "little") == number]

    def last(self, name):
        number = bytes([AUTOPILOT]) + getattr(mavlink, f"MAVLINK_MSG_ID_{name}").to_bytes(3, "little")
        return self._mavlink.decode(bytearray(next(data for _, data in reversed(self._datagrams) if data[6:10] == number)))

    def listen(self, time_s):
        with contextlib.suppress(BlockingIOError):
            while True:
                data, self._vehicle = self._socket.recvfrom(4096)
                self._datagrams.append((time_s, data))


class Flight:
    """A vehicle, stepped by hand; the companion is on its onboard link, and if wanted a station on the other."""

    def __init__(self, station=False, quiet=False, **options):
        """``quiet``: without the messages that the tests of flight modes do not look at; it flies on in less time."""
        self.companion, self.station = Companion(), Companion(system=255)
        others = {
            key: options.pop(key)
            for key in ("places", "localization", "gust_mps2", "frame_yaw_rad", "datum", "localized", "terrain")
            if key in options
        }
        config = Px4Config(onboard=self.companion.address, ground_station=self.station.address if station else None, **options)
        self._quiet = quiet
        self.fleet, self.motion = new_fleet([config], clock_ns=self._clock_ns, **others)

    async def __aenter__(self):
        await self.fleet.start()
        if self._quiet:
            schedule = self.fleet.faces[0].links[0].schedule
            for number in set(ONBOARD_HZ) - _LOOKED_AT:
                schedule.set_interval(number, -1.0, 0.0)
        await self.run(1.0)  # then it has begun to speak
        return self

    async def __aexit__(self, *error):
        self.fleet.close()
        self.companion.close()
        self.station.close()

    def _clock_ns(self):
        return UTC_NS + round(self.fleet.time_s * 1e9) if hasattr(self, "fleet") else UTC_NS

    @property
    def report(self):
        return self.fleet.reports()[0]

    @property
    def position(self):
        """True place of the first vehicle."""
        return self.motion.position_m[0].copy()

    async def run(self, seconds, each=None):
        """Fly on; ``each`` is called 20 times a second."""
        for step in range(round(seconds / STEP_S)):
            if each is not None and step % 5 == 0:
                each()
            await asyncio.sleep(0)  # the loop looks at its sockets
            await asyncio.sleep(0)  # what came in is heard
            self.fleet.step()
            for listener in (self.companion, self.station):
                listener.listen(self.fleet.time_s)

    async def until(self, condition, limit_s, each=None):
        """Seconds until ``condition()``; fails after ``limit_s``."""
        begin_s = self.fleet.time_s
        while not condition():
            assert self.fleet.time_s - begin_s < limit_s, f"not within {limit_s} s: {self.report}"
            await self.run(0.05, each)
        return self.fleet.time_s - begin_s

    def heard(self, name, since_s=0.0, link=None):
        return (link or self.companion).heard(name, since_s)

    def last(self, name, link=None):
        return (link or self.companion).last(name)

    async def ask(self, number, *parameters, wait_s=0.05):
        """Send a command; the results of its acknowledgements."""
        before_s = self.fleet.time_s
        self.companion.command(number, *parameters)
        await self.run(wait_s)
        return [h.message.result for h in self.heard("COMMAND_ACK", before_s + 1e-6) if h.message.command == number]

    async def airborne(self, height_m=5.0):
        """Armed, taken off, holding."""
        await self.until(lambda: self.fleet.time_s > 5.0, 6.0)
        self.companion.send(param_set("MIS_TAKEOFF_ALT", height_m))
        await self.run(0.05)
        assert await self.ask(mavlink.MAV_CMD_NAV_TAKEOFF) == [0]
        assert await self.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0) == [0]
        await self.until(lambda: self.report.mode == "hold" and self.report.in_air, 30.0)
        await self.run(3.0)  # a takeoff ends before the vehicle has come to rest

    async def offboard(self, setpoint):
        """In offboard, with the setpoint sent once."""
        self.companion.send(setpoint)
        assert await self.ask(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 6.0, 0.0) == [0, 0]
        assert self.report.mode == "offboard"

    def origin(self):
        """Of the local frame in the world (ENU)."""
        return self.fleet._frames.origin[0]


def position_target(position_ned, velocity_ned=None, yaw=NAN, mask=None, frame=1):
    """SET_POSITION_TARGET_LOCAL_NED with the mask that its arguments need."""
    velocity = velocity_ned or (0.0, 0.0, 0.0)
    if mask is None:
        mask = 0b1101_1100_0000 | (0 if velocity_ned else 0b111000)
        mask &= ~1024 if isfinite(yaw) else 0xFFFF
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, mask, *position_ned, *velocity, 0.0, 0.0, 0.0, yaw, 0.0
    )


def int_bits(value):
    """An integer parameter's value as it goes over a link."""
    return struct.unpack("<f", struct.pack("<i", value))[0]


def param_set(name, value, kind=9):
    return mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind)
