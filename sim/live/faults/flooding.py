"""A peer that floods the mesh in the name of a drone, in a process of its own: ``python -m radron.sim.live.faults.flooding
PLAN``.

It sends the drone's newest pose again and again, padded to the wanted size by a field unknown to receivers; or valid log
entries beside the drone's own.
"""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
from msgspec import Struct

from radron.protocol.codec import decode_from
from radron.protocol.identity import Identity, load_identity
from radron.protocol.keys import drone_key
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.trust import trust_of
from radron.sim.faults.agents import DenseEntries, Flood, OldEntries
from radron.sim.faults.crowding import Crowd
from radron.sim.faults.network import padded

BURST_S = 0.005  # between two bursts


class FloodPlan(Struct, frozen=True):
    """Which drone a flooding attacker impersonates, and how.

    ``identity``: folder of the drone's certificate. ``mesh``: network addresses of the drones. ``fault``: kind of flood.
    """

    swarm: str
    drone: str
    identity: str
    mesh: tuple[str, ...]
    fault: Flood | OldEntries | DenseEntries


class Padded:
    """Makes a flood of copies of the drone's newest pose, padded to a given size."""

    def __init__(self, fault: Flood) -> None:
        self._fault = fault
        self._copy: tuple[str, bytes] | None = None
        self._began_ns = self._sent = 0

    def take(self, key: str, payload: bytes) -> None:
        """Record a message of the impersonated drone."""
        if self._copy is None and key.endswith("/pose"):
            self._copy = key, padded(payload, self._fault.message_bytes)

    def due(self, now_ns: int) -> Iterator[tuple[str, bytes]]:
        """Yield the messages of the flood that are due by now."""
        if self._copy is None:
            return
        self._began_ns = self._began_ns or now_ns
        while self._sent < self._fault.rate_mbps * 1e-3 * (now_ns - self._began_ns):  # MB/s are bytes in a microsecond
            yield self._copy
            self._sent += len(self._copy[1])


class Entries:
    """Makes a flood of valid log entries."""

    def __init__(self, fault: OldEntries | DenseEntries, swarm: str, identity: Identity) -> None:
        trust = trust_of(identity)
        assert trust is not None
        self._crowd = Crowd(fault, swarm, trust, os.urandom(8).hex())

    def take(self, key: str, payload: bytes) -> None:
        """Record a message of the impersonated drone."""
        self._crowd.follow(decode_from(key, payload))

    def due(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Return the messages of the flood that are due by now."""
        return self._crowd.due(now_ns)


async def flood(plan: FloodPlan, now_ns: Callable[[], int]) -> None:
    """Send the messages of a flood until cancelled."""
    identity = load_identity(Path(plan.identity))
    sender = Padded(plan.fault) if isinstance(plan.fault, Flood) else Entries(plan.fault, plan.swarm, identity)
    heard = {drone_key(plan.swarm, plan.drone, kind) for kind in ("pose", "exposure")}

    def receive(key: str, payload: bytes) -> None:
        if key in heard:
            sender.take(key, payload)

    mesh = await Mesh.open(MeshConfig(connect=plan.mesh, identity=identity), plan.swarm, None, receive=receive)
    try:
        while True:
            for key, payload in sender.due(now_ns()):
                mesh.publish(key, payload)
            await asyncio.sleep(BURST_S)
    finally:
        await mesh.close()


async def _main() -> None:
    plan = msgspec.json.decode(sys.argv[1], type=FloodPlan)
    await flood(plan, time.time_ns)


if __name__ == "__main__":
    asyncio.run(_main())
