"""Swarms on this machine: free endpoints, meshes that record their deliveries, peers in processes of their own."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from radron.protocol.keys import drone_key
from radron.protocol.mesh.session import Mesh, MeshConfig

SWARM = "s"
DEADLINE_S = 10.0  # for an exchange that takes milliseconds on an idle machine
LEASE, LONG_LEASE_MS = "transport/link/tx/lease", 60_000  # a setting of Zenoh; outlasts every test


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def endpoint(port: int | None = None) -> str:
    return f"tcp/127.0.0.1:{port or free_port()}"


async def until(condition: Callable[[], object], deadline_s: float = DEADLINE_S) -> float:
    """Seconds until the condition held."""
    start_s = time.monotonic()
    while not condition():
        passed_s = time.monotonic() - start_s
        assert passed_s < deadline_s, f"not within {deadline_s:g} s"
        await asyncio.sleep(0.002)
    return time.monotonic() - start_s


class Member:
    """A mesh, and what came in. takes_s: how long it takes to receive a message."""

    mesh: Mesh

    def __init__(self, drone: str | None, swarm: str) -> None:
        self.drone = drone
        self.swarm = swarm
        self.messages: list[tuple[str, bytes]] = []
        self.bursts = 0
        self.takes_s = 0.0

    def receive(self, key: str, payload: bytes) -> None:
        self.messages.append((key, payload))
        time.sleep(self.takes_s)

    def drained(self) -> None:
        self.bursts += 1

    def got(self, key: str) -> list[bytes]:
        return [payload for there, payload in self.messages if there == key]

    def publish(self, kind: str, payload: bytes) -> None:
        assert self.drone is not None
        self.mesh.publish(drone_key(self.swarm, self.drone, kind), payload)


@asynccontextmanager
async def member(
    drone: str | None,
    listen: str | None = None,
    connect: tuple[str, ...] = (),
    swarm: str = SWARM,
    answer: Callable[[bytes], list[tuple[str, bytes]]] | None = None,
    members: tuple[str, ...] | None = None,
) -> AsyncIterator[Member]:
    one = Member(drone, swarm)
    config = MeshConfig(listen=listen, connect=connect)
    one.mesh = await Mesh.open(config, swarm, drone, receive=one.receive, drained=one.drained, answer=answer, members=members)
    try:
        yield one
    finally:
        await one.mesh.close()


@asynccontextmanager
async def pair() -> AsyncIterator[tuple[Member, Member]]:
    """Two drones, d1 and d2, that hear each other."""
    first = endpoint()
    async with member("d1", first) as d1, member("d2", endpoint(), (first,)) as d2:
        await linked(d1, d2)
        yield d1, d2


async def linked(*members: Member) -> None:
    drones = {one.drone for one in members if one.drone is not None}
    await until(lambda: all(one.mesh.alive >= drones - {one.drone} for one in members))


@contextmanager
def peer_process(
    drone: str, listen: str, *connect: str, entries: int = 0, pose_bytes: int = 0, pose_hz: float = 20.0, lease_ms: int = 0
) -> Iterator[subprocess.Popen[str]]:
    """A drone in a process of its own (``peer.py``) that has joined; ``lease_ms``: 0: as it is set in flight."""
    script = Path(__file__).with_name("peer.py")
    options = {"entries": entries, "pose-bytes": pose_bytes, "pose-hz": pose_hz, "lease-ms": lease_ms}
    arguments = [*(f"--{name}={value}" for name, value in options.items()), drone, listen, *connect]
    process = subprocess.Popen(
        [sys.executable, str(script), *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "joined\n"
        yield process
    finally:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout):
            assert stream is not None
            stream.close()
