"""Vehicles that are flown by other programs, such as PX4's own simulation, observed through their ground-station links."""

from __future__ import annotations

import asyncio
import math
import socket
import struct
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pymap3d
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from radron.agent.errors import VehicleError
from radron.sim.geometry import Array, Quaternion
from radron.sim.vehicle.px4.config import Address
from radron.sim.vehicle.px4.faults import VehicleFault
from radron.sim.vehicle.px4.filter.satellites import SATELLITES
from radron.sim.vehicle.px4.fleet import VehicleReport
from radron.sim.vehicle.px4.mavlink.link import DATAGRAM_BYTES
from radron.sim.vehicle.px4.modes import Mode

HEARTBEAT_S = 1.0
TRUTH_HZ = 25
_TRUTH_ASKS = 10  # requests; a vehicle that is not simulated has no true state
_FAILSAFE = "Failsafe activated"  # begins the text that PX4 sends at once, up to 1 s before the heartbeat that shows the failsafe
_SYSTEM_ID = 255
_AUTOPILOT = 1  # component id
_CRITICAL = 5  # MAV_STATE: a failsafe is active
_ENU_FROM_NED = Rotation.from_matrix([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FRD_FROM_FLU = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


@dataclass(slots=True)
class _Track:
    """Position of a vehicle, local NED of its source. ``start``: the position before it was first armed."""

    start: Array | None = None
    position: Array = field(default_factory=lambda: np.zeros(3))
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    attitude: Quaternion = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # FRD; level, heading east

    def go(self, position: Array, velocity: Array, flew: bool) -> None:
        """Take a new position; until its first flight, the vehicle stands on its launch place."""
        self.position, self.velocity = position, velocity
        if not flew:
            self.start = position

    @property
    def moved(self) -> Array:
        """Displacement from the launch place."""
        return self.position - self.start if self.start is not None else np.zeros(3)


@dataclass(slots=True)
class _Received:
    """Messages of one vehicle: its own estimate and, if it is simulated, the true state of that simulation.

    ``geodetic``: latitude, longitude in degrees and altitude in metres of the true positions' origin.
    """

    link: Address | None = None
    told: _Track = field(default_factory=_Track)
    true: _Track = field(default_factory=_Track)
    geodetic: tuple[float, float, float] | None = None
    truth_asks: int = 0
    hears_truth: bool = False  # since the last heartbeat
    armed: bool = False
    flew: bool = False
    landed: bool = True
    failsafe: bool = False
    warned: bool = False  # of a failsafe, which the next heartbeat may not show yet
    mode: Mode | None = None

    @property
    def simulated(self) -> bool:
        """Whether the true state is known."""
        return self.true.start is not None

    @property
    def track(self) -> _Track:
        """Return the track that serves as truth."""
        return self.true if self.simulated else self.told


class GroundStation:
    """Observes vehicles flown by other programs, in place of ``Px4Fleet``. MAVLink system ids 1 to N.

    PX4's own simulation is asked for its true state (HIL_STATE_QUATERNION), which serves as truth. For other vehicles, such as
    real ones, the truth is their own estimate. A vehicle stands on its launch place until it is first armed.

    A vehicle forwards messages of its other links: heartbeats of companions, which may all call themselves system 1, and of other
    ground stations. Only messages of the autopilots, component 1 of their systems, are used.

    position_m, velocity_mps: (N, 3), world ENU.
    """

    def __init__(self, places: Array, bind: Address) -> None:
        """``places``: (N, 3), the launch places in the world. ``bind``: address that the vehicles send to."""
        self._places = places
        self._bind = bind
        self._heard = [_Received() for _ in places]
        self._parsers: dict[Address, Any] = {}  # one per link
        self._mavlink = mavlink.MAVLink(None, _SYSTEM_ID, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._socket: socket.socket | None = None
        self._heartbeat: asyncio.TimerHandle | None = None

    @property
    def position_m(self) -> Array:
        """(N, 3) positions in the world, metres."""
        return np.array([self._place(drone) for drone in range(len(self._heard))])

    @property
    def velocity_mps(self) -> Array:
        """(N, 3) velocities in the world, m/s."""
        return np.array([_enu(heard.track.velocity) for heard in self._heard])

    def quaternion(self, drone: int) -> Quaternion:
        """Return a vehicle's attitude (w, x, y, z), which rotates from the body (FLU) to the world (ENU)."""
        w, x, y, z = self._heard[drone].track.attitude
        qx, qy, qz, qw = (_ENU_FROM_NED * Rotation.from_quat([x, y, z, w]) * _FRD_FROM_FLU).as_quat().tolist()
        return qw, qx, qy, qz

    async def start(self) -> None:
        """Listen to the vehicles in the running event loop.

        Raises:
            VehicleError: the port is in use.
        """
        loop = asyncio.get_running_loop()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(self._bind)
        except OSError as error:
            host, port = self._bind
            raise VehicleError(f"ground station: UDP {host}:{port}: {error.strerror}; stop the program that uses it") from None
        loop.add_reader(self._socket, self._read, self._socket)
        self._beat()

    @property
    def address(self) -> Address:
        """Address at which this object listens."""
        assert self._socket is not None
        host, port = self._socket.getsockname()
        return host, port

    def begin(self) -> None:
        """Do nothing at the start of the mission, as no events are scheduled for these vehicles."""

    def step(self) -> None:
        """Do nothing, as the vehicles fly by themselves."""

    def reports(self) -> list[VehicleReport]:
        """Return what an observer sees of each vehicle; setpoints are not seen on this link and count as none."""
        return [
            VehicleReport(
                mode=heard.mode.name.lower() if heard.mode is not None else "unknown",
                armed=heard.armed,
                in_air=not heard.landed,
                failsafe=heard.failsafe,
                setpoints=0,
                computed_setpoints=0,
                largest_gap_s=0.0,
                truth="simulation" if heard.simulated else "estimate",
            )
            for heard in self._heard
        ]

    def switch_satellites(self, drone: int, received: bool) -> None:
        """Switch the satellite reception of a simulated vehicle; other vehicles ignore it."""
        number = SATELLITES if received else 0
        (bits,) = struct.unpack("<f", struct.pack("<i", number))  # PX4 sends an integer's bits in the float
        kind = mavlink.MAV_PARAM_TYPE_INT32
        self._send(drone, mavlink.MAVLink_param_set_message(drone + 1, _AUTOPILOT, b"SIM_GPS_USED", bits, kind))

    def take_over(self, drone: int, mode: str) -> None:
        """Do nothing, as vehicles flown by other programs have their own pilots."""

    def begin_fault(self, drone: int, fault: VehicleFault) -> None:
        """Do nothing, as vehicles flown by other programs have their own faults."""

    def end_fault(self, drone: int, fault: VehicleFault) -> None:
        """Do nothing, as vehicles flown by other programs have their own faults."""

    def close(self) -> None:
        """Stop listening."""
        if self._heartbeat is not None:
            self._heartbeat.cancel()
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _place(self, drone: int) -> Array:
        place: Array = self._places[drone] + _enu(self._heard[drone].track.moved)
        return place

    def _read(self, opened: socket.socket) -> None:
        while True:
            try:
                data, sender = opened.recvfrom(DATAGRAM_BYTES)
            except OSError:
                return
            if sender not in self._parsers:
                self._parsers[sender] = mavlink.MAVLink(None)
                self._parsers[sender].robust_parsing = True
            for message in self._parsers[sender].parse_buffer(data) or ():
                self._receive(sender, message)

    def _receive(self, sender: Address, message: Any) -> None:
        """Take messages of the autopilots; ignore others on their links."""
        drone = message.get_srcSystem() - 1
        if message.get_srcComponent() == _AUTOPILOT and 0 <= drone < len(self._heard):
            self._heard[drone].link = sender
            _take(self._heard[drone], message)

    def _beat(self) -> None:
        """Send a ground station's heartbeat: PX4 requires one before it arms."""
        heartbeat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        for drone, heard in enumerate(self._heard):
            self._send(drone, heartbeat)
            # A simulation that was booted again has to be asked again.
            if heard.link is not None and not heard.hears_truth and (heard.simulated or heard.truth_asks < _TRUTH_ASKS):
                heard.truth_asks += 1
                self._send(drone, _truth_wanted(drone + 1))
            heard.hears_truth = False
        self._heartbeat = asyncio.get_running_loop().call_later(HEARTBEAT_S, self._beat)

    def _send(self, drone: int, message: Any) -> None:
        link = self._heard[drone].link
        if self._socket is None or link is None:
            return
        with suppress(OSError):  # no receiver at the moment
            self._socket.sendto(message.pack(self._mavlink), link)


def _truth_wanted(system: int) -> Any:
    """The request for the true state; intervals are in microseconds."""
    return mavlink.MAVLink_command_long_message(
        system, _AUTOPILOT, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
        0, mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, 1e6 / TRUTH_HZ, 0.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip


def _take(heard: _Received, message: Any) -> None:
    match message.get_type():
        case "LOCAL_POSITION_NED":
            position = np.array([message.x, message.y, message.z])
            heard.told.go(position, np.array([message.vx, message.vy, message.vz]), heard.flew and heard.told.start is not None)
        case "HIL_STATE_QUATERNION":
            _take_truth(heard, message)
        case "ATTITUDE_QUATERNION":
            heard.told.attitude = (message.q1, message.q2, message.q3, message.q4)
        case "HEARTBEAT":
            heard.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            heard.flew = heard.flew or heard.armed
            heard.mode = Mode.of(message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24)
            heard.failsafe = message.system_status == _CRITICAL or heard.warned
            heard.warned = False
        case "STATUSTEXT" if message.text.startswith(_FAILSAFE):
            heard.failsafe = heard.warned = True
        case "EXTENDED_SYS_STATE":
            heard.landed = message.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND


def _take_truth(heard: _Received, message: Any) -> None:
    """Take the simulation's position; ignored if the vehicle is in the air already, as its launch place is unknown then."""
    if heard.flew and not heard.simulated:
        return
    place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
    heard.geodetic, heard.hears_truth = heard.geodetic or place, True
    position = np.array(pymap3d.geodetic2ned(*place, *heard.geodetic))
    heard.true.go(position, np.array([message.vx, message.vy, message.vz]) * 0.01, heard.flew)
    heard.true.attitude = tuple(message.attitude_quaternion)


def _enu(ned: Array) -> Array:
    return np.array([ned[1], ned[0], -ned[2]])
