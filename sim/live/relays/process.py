"""The relays of a live flight, in a process of their own: ``python -m radron.sim.live.relays.process``.

A separate process, because the launcher's loop is busy for seconds at the end of a flight, and a stalled link is a fault. The
first line of the standard input is the ``RelayPlan``, each further one an ``Impair``; its end ends the process.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from random import Random

import msgspec

from radron.sim.live.relays.mavlink import MavlinkRelay
from radron.sim.live.relays.plan import Carried, Impair, RelayPlan
from radron.sim.live.relays.tcp import Relay


class Relays:
    """Runs all relays of a plan in this process."""

    def __init__(self, plan: RelayPlan) -> None:
        self._plan = plan
        self._relays: dict[tuple[str, str], Relay | MavlinkRelay] = {}

    async def start(self) -> None:
        """Listen at all ports. Raises OSError if a port is in use."""
        for carried in self._plan.mesh:
            relay = Relay(carried.target, self._random(carried))
            await relay.start(self._plan.host, carried.port)
            self._relays[carried.dials, carried.dialled] = relay
        for carried in self._plan.mavlink:
            link = MavlinkRelay(carried.target, self._random(carried))
            await link.start(self._plan.host, carried.port)
            self._relays[carried.dials, carried.dialled] = link

    def impair(self, order: Impair) -> None:
        """Set the impairment of one direction of a link."""
        if (relay := self._relays.get((order.sender, order.receiver))) is not None:
            relay.there.state = order.state
        elif (relay := self._relays.get((order.receiver, order.sender))) is not None:
            relay.back.state = order.state

    async def close(self) -> None:
        """Close all relays with their links."""
        await asyncio.gather(*(relay.close() for relay in self._relays.values()))

    def _random(self, carried: Carried) -> Random:
        return Random(f"{self._plan.seed} {carried.dials} {carried.dialled}")


async def _run() -> None:
    loop = asyncio.get_running_loop()
    orders = asyncio.StreamReader(limit=1 << 20)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(orders), sys.stdin)
    relays = Relays(msgspec.json.decode(await orders.readline(), type=RelayPlan))
    try:
        await relays.start()
        os.write(1, b"up\n")
        while line := await orders.readline():
            relays.impair(msgspec.json.decode(line, type=Impair))
    finally:
        await relays.close()


def main() -> None:
    """Run the relays until the end of the standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # handled by the launcher
    try:
        asyncio.run(_run())
    except OSError as error:
        sys.exit(f"radron-sim: the relays: {error}")


if __name__ == "__main__":
    main()
