"""One MAVLink link of a vehicle over UDP: it sends to a fixed address and hears whoever answers to its socket."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mavlink

from agent.errors import VehicleError
from sim.vehicle.px4.config import Address
from sim.vehicle.px4.state import Message, State
from sim.vehicle.px4.streams import Schedule

_LONGEST = 65_536
_SO_TIMESTAMPNS = 35  # Linux: each datagram carries the time at which the kernel had it
_TIMESPEC = struct.Struct("=qq")
_TEXT_CHUNK = 50
Receiver = Callable[["Link", Message], None]


class Link:
    """Sends never block; what does not go out at once is lost, as on a radio."""

    def __init__(self, remote: Address, system_id: int, schedule: Schedule, receive: Receiver) -> None:
        self.schedule = schedule
        self.ground_station_s: float | None = None  # when one was heard last, vehicle's clock
        self.cut = False  # nothing passes, either way
        self.arrived_ns = 0  # UTC, of the message that is being received: when it was here, however late it is read
        self.refused = 0  # datagrams that were not MAVLink, or whose checksum was wrong
        self._remote = remote
        self._receive = receive
        self._mavlink = mavlink.MAVLink(self, system_id, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._mavlink.robust_parsing = True
        self._socket: socket.socket | None = None
        self._texts = 0

    async def start(self) -> None:
        """Open the socket on the running loop.

        Raises:
            VehicleError: a host name that cannot be resolved.
        """
        loop = asyncio.get_running_loop()
        host, port = self._remote
        try:
            found = await loop.getaddrinfo(host, port, family=socket.AF_INET, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise VehicleError(f"emulated vehicle: {host}: {error.strerror}; is the companion's host up?") from None
        self._remote = (str(found[0][4][0]), port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._socket.bind(("", 0))
        loop.add_reader(self._socket, self._read, self._socket)

    def close(self) -> None:
        """Close the socket; nothing is heard or sent any more."""
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def send(self, message: Message | None) -> None:
        """Send a message now."""
        if message is not None:
            self._mavlink.send(message)

    def send_due(self, state: State) -> None:
        """Send what the schedule says."""
        for build in self.schedule.due(state.boot_s):
            self.send(build(state))

    def send_text(self, severity: int, text: str) -> None:
        """A STATUSTEXT in chunks; only ground stations get texts."""
        if self.ground_station_s is None:
            return
        content = text.encode()
        chunks = [content[start : start + _TEXT_CHUNK] for start in range(0, len(content), _TEXT_CHUNK)]
        self._texts = self._texts % 65_535 + 1
        number = self._texts if len(chunks) > 1 else 0
        for index, chunk in enumerate(chunks):
            self.send(mavlink.MAVLink_statustext_message(severity, chunk, number, index))

    def write(self, data: bytes) -> None:
        """For pymavlink: one datagram."""
        if self._socket is not None and not self.cut:
            try:
                self._socket.sendto(data, self._remote)
            except OSError:
                return  # a full buffer, or nobody there: lost

    def _read(self, opened: socket.socket) -> None:
        while True:
            try:
                data, ancillary, _, _ = opened.recvmsg(_LONGEST, socket.CMSG_SPACE(_TIMESPEC.size))
            except OSError:
                return
            if self.cut:
                continue
            seconds, nanoseconds = _TIMESPEC.unpack(ancillary[0][2])
            self.arrived_ns = seconds * 1_000_000_000 + nanoseconds
            for message in self._mavlink.parse_buffer(data) or ():
                if message.get_type() == "BAD_DATA":
                    self.refused += 1
                else:
                    self._receive(self, message)
