"""The MAVLink link to one autopilot, through MAVSDK: messages in, messages out, nothing of what they mean.

Messages come on MAVSDK's threads; they are stamped and decoded there, and handed to the event loop, one wake-up per burst.
Sending is a direct call into MAVSDK. Nobody but the caller repeats anything: when Python hangs, the setpoints stop, and the
autopilot's own failsafe sees it. (MAVSDK's offboard plugin would go on sending the last one from a thread of its own.)
"""

from __future__ import annotations

import asyncio
import errno
import re
import socket
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import msgspec
from mavsdk import logging as mavsdk_logging
from mavsdk.asyncio import Autopilot, ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.exceptions import MavsdkConnectionError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from msgspec import Struct

from agent.errors import VehicleError
from agent.vehicle.messages import DECODERS, Attitude, DistanceSensor, Message, Odometry

AUTOPILOT_COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1
COMMANDS_PER_MESSAGE = 7
MOST_WAITING = 2000  # messages not yet taken by the loop: some seconds
_PATIENT = (Attitude, DistanceSensor, Odometry)  # frequent, and of no use before the next position: they do not wake the loop
_UDP = re.compile(r"(?:udp|udpin)://([^:/]*):(\d+)$")


class Received(Struct, frozen=True):
    """A message and when it arrived: UTC, and seconds of a clock that never goes back."""

    message: Message
    arrival_ns: int
    arrival_s: float


class Link:
    """One autopilot. All methods are called in the event loop's thread; so are the callbacks."""

    def __init__(self, address: str, clock_ns: Callable[[], int]) -> None:
        self.address = address
        self.counters: Counter[str] = Counter()
        self._clock_ns = clock_ns
        self._mavsdk: Mavsdk | None = None
        self._direct: MavlinkDirect | None = None
        self._system_id = 0
        self._waiting: deque[Received] = deque(maxlen=MOST_WAITING)
        self._woken = False

    async def open(self, timeout_s: float, receive: Callable[[list[Received]], None]) -> None:
        """Connect; ``receive`` then gets every burst of messages.

        Raises:
            VehicleError: a bad address, a port in use, nobody there within ``timeout_s``, or not a PX4.
        """
        self._loop = asyncio.get_running_loop()
        self._receive = receive
        _claim_port(self.address)
        mavsdk_logging.log_subscribe(lambda *_: True)  # else it prints to the standard output
        self._mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
        try:
            await self._mavsdk.add_any_connection(self.address)
        except MavsdkConnectionError as error:
            raise VehicleError(
                f"{self.address}: cannot be opened ({error}); an address is like udpin://0.0.0.0:14540 or serial:///dev/ttyACM0:57600"
            ) from None
        system = await self._mavsdk.first_autopilot(timeout_s)
        if system is None:
            raise VehicleError(
                f"no autopilot on {self.address} within {timeout_s:g} s; is it on, and does it send to this address and port?"
            )
        if await system.autopilot_type() is Autopilot.ARDUPILOT:
            raise VehicleError(f"the autopilot on {self.address} is an ArduPilot; only PX4 is supported")
        self._system = system  # MAVSDK releases what nobody holds
        self._system_id = await system.get_system_id()
        self._direct = MavlinkDirect(system._system)
        for name in DECODERS:
            self._direct.subscribe_message(name, self._arrived)

    def send(self, name: str, fields: dict[str, Any]) -> None:
        """Send a message to the autopilot at once; None is NaN. What cannot be sent is counted: the link is lost then."""
        if self._direct is None:
            return
        fields["target_system"], fields["target_component"] = self._system_id, AUTOPILOT_COMPONENT
        text = msgspec.json.encode(fields).decode()
        try:
            self._direct.send_message(MavlinkMessage(name, 0, 0, self._system_id, AUTOPILOT_COMPONENT, text))
        except MavlinkDirectError:
            self.counters["not_sent"] += 1

    def send_command(self, command: int, *parameters: float | None) -> None:
        """Send a COMMAND_LONG once; parameters not given are NaN, which leaves them to the autopilot."""
        fields: dict[str, Any] = {f"param{number + 1}": None for number in range(COMMANDS_PER_MESSAGE)}
        fields.update({f"param{number}": value for number, value in enumerate(parameters, start=1)})
        self.send("COMMAND_LONG", {"command": command, "confirmation": 0, **fields})

    def close(self) -> None:
        """Release everything, in a few milliseconds: no command of MAVSDK's own is under way, which would have to end first."""
        direct, self._direct = self._direct, None
        if direct is not None:
            direct.destroy()
        mavsdk, self._mavsdk = self._mavsdk, None
        if mavsdk is not None:
            mavsdk.destroy()
        self._waiting.clear()

    def _arrived(self, message: MavlinkMessage, _: object) -> None:
        """On a thread of MAVSDK's."""
        if message.component_id != AUTOPILOT_COMPONENT:
            return
        try:
            decoded = DECODERS[message.message_name].decode(message.fields_json)
        except msgspec.DecodeError:
            self.counters["malformed"] += 1
            return
        self._waiting.append(Received(decoded, self._clock_ns(), time.monotonic()))
        if not self._woken and not isinstance(decoded, _PATIENT) and not self._loop.is_closed():
            self._woken = True
            self._loop.call_soon_threadsafe(self._drain)

    def _drain(self) -> None:
        self._woken = False
        burst = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if burst and self._direct is not None:
            self._receive(burst)


def _claim_port(address: str) -> None:
    """See that nobody else listens on a UDP address: MAVSDK would share the port, and each would get half of the packets."""
    match = _UDP.match(address)
    if match is None:
        return
    host, port = match.group(1) or "0.0.0.0", int(match.group(2))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((host, port))
        except OverflowError:
            raise VehicleError(f"{address}: {port} is not a port") from None
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise VehicleError(f"{address}: the port is in use; is another agent or ground station running here?") from None
            raise VehicleError(f"{address}: cannot listen there: {error.strerror or error}") from None
