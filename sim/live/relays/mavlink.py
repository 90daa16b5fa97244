"""UDP relay between an emulated vehicle and its agent, which impairs the MAVLink packets.

Packets are lost, delayed, reordered, duplicated or changed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from random import Random
from typing import cast

from radron.sim.live.relays.linkstate import Packets
from radron.sim.vehicle.px4.config import Address

_Scheduler = Callable[[float, Callable[[], None]], object]


class MavlinkRelay:
    """Relay that impairs the MAVLink packets between a vehicle and its agent.

    ``there``: direction from the vehicle to the agent; ``back``: from the agent to the vehicle.
    """

    def __init__(
        self, agent: Address, random: Random, now_s: Callable[[], float] | None = None, call_at: _Scheduler | None = None
    ) -> None:
        """``agent``: address of the agent. ``now_s``, ``call_at``: clock and timer; None: of the running event loop."""
        loop = asyncio.get_running_loop()
        self.there, self.back = Packets(random), Packets(random)
        self._agent = agent
        self._vehicle: Address | None = None  # source of its datagrams
        self._now_s, self._call_at = now_s or loop.time, call_at or loop.call_at
        self._front: asyncio.DatagramTransport | None = None
        self._rear: asyncio.DatagramTransport | None = None

    async def start(self, host: str, port: int = 0) -> int:
        """Open the sockets, and return the port for the vehicle (0: a free one is chosen). Raises OSError if it is in use."""
        loop = asyncio.get_running_loop()
        front, _ = await loop.create_datagram_endpoint(lambda: _Receiver(self._from_vehicle), local_addr=(host, port))
        self._front = front
        rear, _ = await loop.create_datagram_endpoint(lambda: _Receiver(self._from_agent), local_addr=(host, 0))
        self._rear = rear
        return cast(int, front.get_extra_info("sockname")[1])

    async def close(self) -> None:
        """Close the sockets; packets on their way are lost."""
        for transport in (self._front, self._rear):
            if transport is not None:
                transport.abort()
        self._front = self._rear = None

    def _from_vehicle(self, data: bytes, source: Address) -> None:
        self._vehicle = source
        self._carry(self.there, data, self._to_agent)

    def _from_agent(self, data: bytes, _: Address) -> None:
        self._carry(self.back, data, self._to_vehicle)

    def _to_agent(self, packet: bytes) -> None:
        if self._rear is not None:
            self._rear.sendto(packet, self._agent)

    def _to_vehicle(self, packet: bytes) -> None:
        if self._front is not None and self._vehicle is not None:
            self._front.sendto(packet, self._vehicle)

    def _carry(self, direction: Packets, data: bytes, send: Callable[[bytes], None]) -> None:
        now_s = self._now_s()
        for due_s, packet in direction.carry(data, now_s):
            if due_s <= now_s:
                send(packet)
            else:
                self._call_at(due_s, partial(send, packet))


class _Receiver(asyncio.DatagramProtocol):
    """Passes datagrams on; they are lost without a receiver, as on a radio."""

    def __init__(self, receive: Callable[[bytes, Address], None]) -> None:
        self._receive = receive

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self._receive(data, addr)
