"""Vehicles that somebody else flies, such as PX4's own simulation, as their ground-station links tell of them."""

from __future__ import annotations

import asyncio
import math
import socket
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from agent.errors import VehicleError
from sim.vehicle.px4.config import Address
from sim.vehicle.px4.fleet import VehicleReport
from sim.vehicle.px4.modes import Mode

HEARTBEAT_S = 1.0
_SYSTEM_ID = 255
_LONGEST = 65_536
_CRITICAL = 5  # MAV_STATE: a failsafe flies
_ENU_FROM_NED = Rotation.from_matrix([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FRD_FROM_FLU = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
Array = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]


@dataclass(slots=True)
class _Heard:
    """What one vehicle has told; local NED, FRD. ``start``: its position before it was first armed."""

    start: Array | None = None
    position: Array = field(default_factory=lambda: np.zeros(3))
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    attitude: Quaternion = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # level, heading east
    armed: bool = False
    flew: bool = False
    landed: bool = True
    failsafe: bool = False
    mode: Mode | None = None


class GroundStation:
    """Listens to vehicles 0 .. N-1, MAVLink system ids 1 .. N; to the world it is what ``Px4Fleet`` and its motion are.

    A vehicle tells where it is in its own frame, by its own estimate: that is what counts as the truth here. It stands on its
    launch place until it is first armed.

    position_m, velocity_mps: (N, 3), world ENU.
    """

    def __init__(self, places: Array, bind: Address) -> None:
        """``places``: (N, 3), the launch places in the world. ``bind``: where the vehicles send to."""
        self._places = places
        self._bind = bind
        self._heard = [_Heard() for _ in places]
        self._parsers: dict[Address, Any] = {}  # one link each
        self._mavlink = mavlink.MAVLink(None, _SYSTEM_ID, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._socket: socket.socket | None = None
        self._heartbeat: asyncio.TimerHandle | None = None

    @property
    def position_m(self) -> Array:
        """(N, 3)."""
        return np.array([self._place(drone) for drone in range(len(self._heard))])

    @property
    def velocity_mps(self) -> Array:
        """(N, 3)."""
        return np.array([_enu(heard.velocity) for heard in self._heard])

    def quaternion(self, drone: int) -> Quaternion:
        """World-from-body attitude (w, x, y, z), FLU in ENU."""
        w, x, y, z = self._heard[drone].attitude
        qx, qy, qz, qw = (_ENU_FROM_NED * Rotation.from_quat([x, y, z, w]) * _FRD_FROM_FLU).as_quat().tolist()
        return qw, qx, qy, qz

    async def start(self) -> None:
        """Listen on the running loop.

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
            raise VehicleError(f"ground station: UDP {host}:{port}: {error.strerror}; end what listens there") from None
        loop.add_reader(self._socket, self._read, self._socket)
        self._beat()

    @property
    def address(self) -> Address:
        """Where it listens."""
        assert self._socket is not None
        host, port = self._socket.getsockname()
        return host, port

    def begin(self) -> None:
        """The mission begins: what happens to these vehicles is not decided here."""

    def step(self) -> None:
        """Nothing: the vehicles fly by themselves."""

    def reports(self) -> list[VehicleReport]:
        """One for each vehicle; setpoints are not seen on this link and count as none."""
        return [
            VehicleReport(
                mode=heard.mode.name.lower() if heard.mode is not None else "unknown",
                armed=heard.armed,
                in_air=not heard.landed,
                failsafe=heard.failsafe,
                setpoints=0,
                computed_setpoints=0,
                largest_gap_s=0.0,
            )
            for heard in self._heard
        ]

    def close(self) -> None:
        """Stop listening."""
        if self._heartbeat is not None:
            self._heartbeat.cancel()
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _place(self, drone: int) -> Array:
        heard = self._heard[drone]
        moved = heard.position - heard.start if heard.start is not None else np.zeros(3)
        place: Array = self._places[drone] + _enu(moved)
        return place

    def _read(self, opened: socket.socket) -> None:
        while True:
            try:
                data, sender = opened.recvfrom(_LONGEST)
            except OSError:
                return
            if sender not in self._parsers:
                self._parsers[sender] = mavlink.MAVLink(None)
                self._parsers[sender].robust_parsing = True
            for message in self._parsers[sender].parse_buffer(data) or ():
                drone = message.get_srcSystem() - 1
                if 0 <= drone < len(self._heard):
                    self._take(self._heard[drone], message)

    def _take(self, heard: _Heard, message: Any) -> None:
        match message.get_type():
            case "LOCAL_POSITION_NED":
                heard.position = np.array([message.x, message.y, message.z])
                heard.velocity = np.array([message.vx, message.vy, message.vz])
                if heard.start is None or not heard.flew:
                    heard.start = heard.position
            case "ATTITUDE_QUATERNION":
                heard.attitude = (message.q1, message.q2, message.q3, message.q4)
            case "HEARTBEAT":
                heard.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                heard.flew = heard.flew or heard.armed
                heard.mode = Mode.of(message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24)
                heard.failsafe = message.system_status == _CRITICAL
            case "EXTENDED_SYS_STATE":
                heard.landed = message.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND

    def _beat(self) -> None:
        """Say that a ground station is there: PX4 looks for one before it lets a vehicle arm."""
        data = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        ).pack(self._mavlink)
        for sender in self._parsers:
            if self._socket is not None:
                try:
                    self._socket.sendto(data, sender)
                except OSError:
                    continue  # nobody there just now
        self._heartbeat = asyncio.get_running_loop().call_later(HEARTBEAT_S, self._beat)


def _enu(ned: Array) -> Array:
    return np.array([ned[1], ned[0], -ned[2]])
