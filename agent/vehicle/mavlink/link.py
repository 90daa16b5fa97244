"""The MAVLink link to one autopilot through MAVSDK: it transports messages without interpreting them.

Messages come on MAVSDK's threads; they are stamped and decoded there, and handed to the event loop, one wake-up per burst.
Sending is a direct call into MAVSDK. Only the caller repeats anything: when Python hangs, the setpoints stop, and the autopilot's
failsafe notices. (MAVSDK's offboard plugin would continue to send the last setpoint from a thread of its own.)
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import msgspec
from mavsdk import logging as mavsdk_logging
from mavsdk.asyncio import Autopilot, ComponentType, Configuration, Mavsdk, System
from mavsdk.asyncio.exceptions import MavsdkConnectionError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from msgspec import Struct

from radron.agent.errors import VehicleError
from radron.agent.vehicle.mavlink.claim import claim_port
from radron.agent.vehicle.mavlink.device import check_device
from radron.agent.vehicle.mavlink.exposure import exposure, take_only_from
from radron.agent.vehicle.mavlink.messages import DECODERS, Attitude, DistanceSensor, Message, Odometry
from radron.agent.vehicle.mavlink.overhearing import listens
from radron.agent.vehicle.mavlink.signed import FIRST_S, First, first_message

AUTOPILOT_COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1
COMMANDS_PER_MESSAGE = 7
LOOK_S = 0.1  # between two looks for a given autopilot
MOST_WAITING = 2000  # messages not yet taken by the loop: some seconds
_PATIENT = (Attitude, DistanceSensor, Odometry)  # frequent, and only used with the next position: they do not wake the loop


class Received(Struct, frozen=True):
    """A MAVLink message with its time of arrival: own time (ns), and seconds of a clock that never goes back."""

    message: Message
    arrival_ns: int
    arrival_s: float


class Link:
    """The MAVLink connection to one autopilot. All methods and callbacks are called in the event loop's thread."""

    def __init__(
        self,
        address: str,
        clock_ns: Callable[[], int],
        clock_s: Callable[[], float],
        system_id: int | None = None,
        source: str | None = None,
    ) -> None:
        """Set up a link that is not open yet.

        ``clock_ns``: own time; ``clock_s``: a clock that never goes back; ``system_id``: MAVLink id of the vehicle; None: the
        first vehicle heard. ``source``: IP address whose packets are accepted; None: the address of the first vehicle heard, or
        any on a loopback.
        """
        self.address = address
        self.counters: Counter[str] = Counter()
        self.is_signed: bool | None = None  # as its first message was; None: not known
        self._clock_ns, self._clock_s = clock_ns, clock_s
        self._wanted_id = system_id
        self._source = source
        self.taken_from = source  # the IP address whose packets are taken; None: all
        self._mavsdk: Mavsdk | None = None
        self._direct: MavlinkDirect | None = None
        self._system_id = 0
        self._waiting: deque[Received] = deque(maxlen=MOST_WAITING)
        self._woken = False

    async def open(self, timeout_s: float, receive: Callable[[list[Received]], None]) -> None:
        """Connect to the autopilot; from then on ``receive`` is called with the messages that arrived together, as a list.

        Raises:
            VehicleError: a bad address, a port in use, a device that cannot be opened, no autopilot in ``timeout_s``, not a PX4.
        """
        self._loop = asyncio.get_running_loop()
        self._receive = receive
        check_device(self.address)
        await claim_port(self.address)
        first = await self._first(timeout_s)
        wanted = self._wanted_id if first is None else first.system
        mavsdk_logging.log_subscribe(lambda *_: True)  # otherwise it prints to standard output
        self._mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
        try:
            await self._mavsdk.add_any_connection(self.address)
        except MavsdkConnectionError as error:
            raise VehicleError(
                f"{self.address}: cannot be opened ({error}); an address is like udpin://127.0.0.1:14540 or serial:///dev/ttyACM0:57600"
            ) from None
        if self.taken_from is not None:
            take_only_from(self.address, self.taken_from)
        system = await self._find(self._mavsdk, wanted, timeout_s)
        if system is None:
            raise self._nobody(timeout_s)
        if await system.autopilot_type() is Autopilot.ARDUPILOT:
            raise VehicleError(f"the autopilot on {self.address} is an ArduPilot; only PX4 is supported")
        self._system = system  # MAVSDK releases systems that are not referenced
        self._system_id = await system.get_system_id()
        self._direct = MavlinkDirect(system._system)
        for name in DECODERS:
            self._direct.subscribe_message(name, self._arrived)

    async def _first(self, timeout_s: float) -> First | None:
        """The first message of the vehicle. On a link open to any sender, nothing is opened before this message: the sender whose
        packets count must be known by then.
        """
        is_open = listens(self.address)
        wait_s = timeout_s if is_open else min(FIRST_S, timeout_s)
        first = await first_message(self.address, self._wanted_id, self._source, wait_s)
        if first is None and is_open:
            raise self._nobody(timeout_s)
        self.is_signed = None if first is None else first.is_signed
        is_exposed = exposure(self.address) is not None
        self.taken_from = self._source or (first.sender if first is not None and is_exposed else None)
        return first

    def _nobody(self, timeout_s: float) -> VehicleError:
        which = "autopilot" if self._wanted_id is None else f"autopilot with system_id {self._wanted_id}"
        where = self.address if self._source is None else f"{self.address} from {self._source}"
        text = "is it powered, and does it send to this address and port?"
        return VehicleError(f"no {which} on {where} within {timeout_s:g} s; {text}")

    async def _find(self, mavsdk: Mavsdk, wanted: int | None, timeout_s: float) -> System | None:
        """The autopilot with the wanted system id, or the first one."""
        if wanted is None:
            return await mavsdk.first_autopilot(timeout_s)
        deadline_s = self._loop.time() + timeout_s
        while self._loop.time() < deadline_s:
            for system in await mavsdk.get_systems():
                if await system.get_system_id() == wanted and await system.has_autopilot():
                    return system
            await asyncio.sleep(LOOK_S)
        return None

    def send(self, name: str, fields: dict[str, Any]) -> None:
        """Send a message to the autopilot at once.

        name, fields: the message's name and fields in MAVLink; None is sent as NaN. Failures are counted: the link is lost then.
        """
        if self._direct is None:
            return
        target = {"target_system": self._system_id, "target_component": AUTOPILOT_COMPONENT}
        text = msgspec.json.encode(fields | target).decode()
        try:
            self._direct.send_message(MavlinkMessage(name, 0, 0, self._system_id, AUTOPILOT_COMPONENT, text))
        except MavlinkDirectError:
            self.counters["not_sent"] += 1

    def send_command(self, command: int, *parameters: float | None) -> None:
        """Send a COMMAND_LONG with this command number once; missing parameters are NaN, which leaves them to the autopilot."""
        fields: dict[str, Any] = {f"param{number + 1}": None for number in range(COMMANDS_PER_MESSAGE)}
        fields.update({f"param{number}": value for number, value in enumerate(parameters, start=1)})
        self.send("COMMAND_LONG", {"command": command, "confirmation": 0, **fields})

    def close(self) -> None:
        """Close the connection, in a few milliseconds: MAVSDK has no pending command to wait for."""
        direct, self._direct = self._direct, None
        if direct is not None:
            direct.destroy()
        mavsdk, self._mavsdk = self._mavsdk, None
        if mavsdk is not None:
            mavsdk.destroy()
        self._waiting.clear()

    def _arrived(self, message: MavlinkMessage, _: object) -> None:
        """On one of MAVSDK's threads. PX4 also forwards messages of others: a ground station, other vehicles and their agents."""
        if message.system_id != self._system_id or message.component_id != AUTOPILOT_COMPONENT:
            self.counters["of_others"] += 1
            return
        try:
            decoded = DECODERS[message.message_name].decode(message.fields_json)
        except msgspec.DecodeError:
            self.counters["malformed"] += 1
            return
        self._waiting.append(Received(decoded, self._clock_ns(), self._clock_s()))
        if not self._woken and not isinstance(decoded, _PATIENT) and not self._loop.is_closed():
            self._woken = True
            self._loop.call_soon_threadsafe(self._drain)

    def _drain(self) -> None:
        self._woken = False
        burst = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if burst and self._direct is not None:
            self._receive(burst)
