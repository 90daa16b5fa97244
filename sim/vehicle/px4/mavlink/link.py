"""One MAVLink link of a vehicle over UDP: it sends to a fixed address and receives all data sent to its socket."""

from __future__ import annotations

import asyncio
import socket
import struct
from collections.abc import Callable

from pymavlink.dialects.v20 import common as mavlink

from radron.agent.errors import VehicleError
from radron.sim.vehicle.px4.config import Address
from radron.sim.vehicle.px4.mavlink.streams import Schedule
from radron.sim.vehicle.px4.mavlink.texts import Texts
from radron.sim.vehicle.px4.state import Message, State

DATAGRAM_BYTES = 65_536
_SO_TIMESTAMPNS = 35  # Linux: each datagram carries the time at which the kernel had it
_TIMESPEC = struct.Struct("=qq")
Receiver = Callable[["Link", Message], None]


class Link:
    """A MAVLink link of an emulated vehicle over UDP.

    Sending never blocks; data that cannot be sent at once are lost, as on a radio.
    """

    def __init__(self, remote: Address, system_id: int, schedule: Schedule, receive: Receiver) -> None:
        self.schedule = schedule
        self.texts = Texts()
        self.cut = False  # nothing passes in either direction
        self.arrived_ns = 0  # UTC arrival time of the message being received, however late it is read
        self.refused = 0  # datagrams that were not MAVLink, or had a wrong checksum
        self._remote = remote
        self._receive = receive
        self._mavlink = mavlink.MAVLink(self, system_id, mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._mavlink.robust_parsing = True
        self._socket: socket.socket | None = None
        self._wire: Callable[[bytes], None] | None = None

    async def start(self) -> None:
        """Open the link's socket in the running event loop.

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
        """Close the link's socket."""
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def send(self, message: Message | None) -> None:
        """Send a message now; None is ignored."""
        if message is not None:
            self._mavlink.send(message)

    def send_due(self, state: State) -> None:
        """Send the messages that are due by the link's schedule."""
        for build in self.schedule.due(state.boot_s):
            self.send(build(state))
        for text in self.texts.due(state.boot_s):
            self.send(text)

    def forward(self, message: Message) -> None:
        """Send a message of another link unchanged."""
        self.write(bytes(message.get_msgbuf()))

    def write(self, data: bytes) -> None:
        """Send one datagram; called by pymavlink."""
        if self.cut:
            return
        if self._wire is not None:
            self._wire(data)
        elif self._socket is not None:
            try:
                self._socket.sendto(data, self._remote)
            except OSError:
                return  # a full buffer, or no receiver: lost

    def attach(self, wire: Callable[[bytes], None]) -> None:
        """Send to the function ``wire`` instead of over UDP; received data is then given to :meth:`hear`."""
        self._wire = wire

    def hear(self, data: bytes, arrived_ns: int) -> None:
        """Process received data. ``arrived_ns``: time of arrival, nanoseconds UTC."""
        if self.cut:
            return
        self.arrived_ns = arrived_ns
        for message in self._mavlink.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA":
                self.refused += 1
            else:
                self._receive(self, message)

    def _read(self, opened: socket.socket) -> None:
        while True:
            try:
                data, ancillary, _, _ = opened.recvmsg(DATAGRAM_BYTES, socket.CMSG_SPACE(_TIMESPEC.size))
            except OSError:
                return
            seconds, nanoseconds = _TIMESPEC.unpack(ancillary[0][2])
            self.hear(data, seconds * 1_000_000_000 + nanoseconds)
