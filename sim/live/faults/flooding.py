"""A peer that floods the mesh in the name of a drone, a process of its own: ``python -m sim.live.faults.flooding PLAN``.

It sends the drone's newest pose again and again, padded to the wanted size by a field that no receiver knows: valid messages, and
many of them.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
from msgspec import Struct

from protocol.identity import load_identity
from protocol.keys import drone_key
from protocol.mesh.session import Mesh, MeshConfig
from sim.faults.network import padded

BURST_S = 0.005  # between two bursts


class FloodPlan(Struct, frozen=True):
    """Whose messages are sent, with the folder of its certificate, where the drones listen, and how much: bytes a second, in
    messages of so many bytes.
    """

    swarm: str
    drone: str
    identity: str
    mesh: tuple[str, ...]
    rate_bytes_ps: float
    message_bytes: int


async def flood(plan: FloodPlan, now_s: Callable[[], float]) -> None:
    """Send until cancelled."""
    key = drone_key(plan.swarm, plan.drone, "pose")
    payload = b""

    def receive(place: str, message: bytes) -> None:
        nonlocal payload
        if place == key and not payload:
            payload = padded(message, plan.message_bytes)

    links = MeshConfig(connect=plan.mesh, identity=load_identity(Path(plan.identity)))
    mesh = await Mesh.open(links, plan.swarm, None, receive=receive)
    try:
        while not payload:
            await asyncio.sleep(BURST_S)
        began_s, sent = now_s(), 0.0
        while True:
            while sent < plan.rate_bytes_ps * (now_s() - began_s):
                mesh.publish(key, payload)
                sent += len(payload)
            await asyncio.sleep(BURST_S)
    finally:
        await mesh.close()


async def _main() -> None:
    plan = msgspec.json.decode(sys.argv[1], type=FloodPlan)
    await flood(plan, asyncio.get_running_loop().time)


if __name__ == "__main__":
    asyncio.run(_main())
