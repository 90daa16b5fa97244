"""The mesh alone: time until it is complete, and message latency, against raw Zenoh and unencrypted links in the same run.

`python benchmarks/mesh.py [--seconds S] [--drones 3,6,10] [--json OUT]`. Each peer is a separate process on this machine.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import socket
import statistics
import tempfile
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from zenoh import CongestionControl
from zenoh.handlers import Callback

from common.goals import Goal
from common.goals import show as show_goals
from radron.protocol.identity import Role, load_identity
from radron.protocol.issuing import throwaway
from radron.protocol.keys import ROOT, drone_key
from radron.protocol.mesh.link import open_session
from radron.protocol.mesh.session import Mesh, MeshConfig

RATE_HZ = 50.0
PAYLOAD_BYTES = 400  # a cone
ROUTES = (
    "raw Zenoh put to callback",
    "news: publish to receive",
    "log entries: publish to receive",
    "news, not encrypted",
    "log entries, not encrypted",
)
RAW_KEY = f"{ROOT}/benchmark/raw"
DEADLINE_S = 60.0
MOST_DRONES = 20
FULL_MESH_S = 10.0  # goal, of ten on two cores

SPAWN = multiprocessing.get_context("spawn")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="for which messages are sent")
    parser.add_argument("--drones", default="3,6,10", help="sizes of the swarms")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        names = [f"d{number}" for number in range(MOST_DRONES)]
        throwaway({Path(folder, name): (name, Role.DRONE) for name in names}, time.time_ns())
        meshes = {int(number): full_mesh(int(number), folder) for number in options.drones.split(",")}
        delays = latencies(options.seconds, folder)
    figures = {
        "full_mesh": {str(number): {"from_start_s": start, "from_open_s": opened} for number, (start, opened) in meshes.items()},
        "latency_ms": {name: dict(zip(("p50", "p99", "max"), values, strict=True)) for name, values in delays.items()},
    }
    show(meshes, delays)
    goals = [
        Goal(
            f"{number} drones, from the last one's opening of its session",
            open_s,
            FULL_MESH_S,
            "s",
            f"{start_s:.1f} s from the start of the processes",
        )
        for number, (start_s, open_s) in meshes.items()
        if number <= 10
    ]
    show_goals("Full mesh, encrypted", goals)
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


def show(meshes: dict[int, tuple[float, float]], delays: dict[str, tuple[float, float, float]]) -> None:
    print("drones   full mesh: from the start of the processes   from the last one's opening of its session")
    for number, (start_s, open_s) in meshes.items():
        print(f"{number:6} {start_s:39.2f} s {open_s:45.2f} s")
    print(f"\n{PAYLOAD_BYTES} bytes at {RATE_HZ:g} Hz each, interleaved       p50        p99    largest")
    for name, values in delays.items():
        print(f"{name:40}" + "".join(f"{value:8.2f} ms" for value in values))


def links(folder: str, drone: str, listen: str, connect: tuple[str, ...] = ()) -> MeshConfig:
    """As in flight: encrypted, and with access control."""
    drones = tuple(f"d{number}" for number in range(MOST_DRONES))
    return MeshConfig(listen=listen, connect=connect, identity=load_identity(Path(folder, drone)), drones=drones)


def full_mesh(number: int, folder: str) -> tuple[float, float]:
    """Seconds until every peer sees all others: since the first process started; since the last one began to open its session."""
    ends = [f"tls/127.0.0.1:{port}" for port in free_ports(number)]
    start_s = time.monotonic()
    peers = [start(join, folder, f"d{i}", ends[i], tuple(ends[:i]), number) for i in range(number)]
    times = [pipe.recv() for _, pipe in peers]
    stop(peers)
    complete_s = max(complete for _, complete in times)
    return complete_s - start_s, complete_s - max(opening for opening, _ in times)


def join(pipe: Connection, folder: str, drone: str, listen: str, connect: tuple[str, ...], number: int) -> None:
    """A drone of ``number``; sends the times at which it began to open its session, and saw all others."""

    async def run() -> None:
        opening_s = time.monotonic()
        mesh = await Mesh.open(links(folder, drone, listen, connect), "benchmark", drone, receive=ignore)
        await until(lambda: len(mesh.alive) == number - 1)
        pipe.send((opening_s, time.monotonic()))
        await asyncio.to_thread(pipe.recv)
        await mesh.close()

    asyncio.run(run())


def latencies(seconds: float, folder: str) -> dict[str, tuple[float, float, float]]:
    """p50, p99 and largest delay in ms by each route, from one process to another."""
    ports = free_ports(6)
    ends = [f"{kind}/127.0.0.1:{port}" for kind, port in zip(("tcp", "tls", "tcp", "tls", "tcp", "tcp"), ports, strict=True)]
    peers = [start(hear, folder, ends), start(tell, folder, ends, seconds)]
    count = peers[1][1].recv()
    peers[0][1].send("stop")
    received = peers[0][1].recv()
    stop(peers)
    lost = {route: count - len(values) for route, values in received.items() if len(values) < count}
    if lost:
        print(f"not delivered, of {count} (of news: superseded by newer ones): {lost}")
    return {
        route: (*(statistics.quantiles(values, n=100)[i] for i in (49, 98)), max(values)) for route, values in received.items()
    }


def hear(pipe: Connection, folder: str, ends: list[str]) -> None:
    delays_ms: dict[str, list[float]] = {route: [] for route in ROUTES}

    def note(route: str, payload: bytes) -> None:
        delays_ms[route].append((time.monotonic_ns() - int.from_bytes(payload[:8], "big")) * 1e-6)

    async def run() -> None:
        raw = await open_session(MeshConfig(listen=ends[0]), dial_all=False)
        subscriber = raw.declare_subscriber(
            RAW_KEY, Callback(lambda sample: note(ROUTES[0], sample.payload.to_bytes()), indirect=False)
        )
        routes = {drone_key("benchmark", "d1", "pose"): ROUTES[1], drone_key("benchmark", "d1", "cone"): ROUTES[2]}
        mesh = await Mesh.open(
            links(folder, "d0", ends[1]), "benchmark", "d0", receive=lambda key, payload: note(routes[key], payload)
        )
        plain_routes = dict(zip(routes, ROUTES[3:], strict=True))
        plain = await Mesh.open(
            MeshConfig(listen=ends[4]), "benchmark", "d0", receive=lambda key, payload: note(plain_routes[key], payload)
        )
        pipe.send("ready")
        await asyncio.to_thread(pipe.recv)
        await asyncio.sleep(0.2)  # the last ones
        pipe.send(delays_ms)
        await mesh.close()
        await plain.close()
        subscriber.undeclare()
        raw.close()
        pipe.recv()

    asyncio.run(run())


def tell(pipe: Connection, folder: str, ends: list[str], seconds: float) -> None:
    """Stamps its messages with the monotonic clock, which all processes of a machine share."""

    async def run() -> None:
        raw = await open_session(MeshConfig(listen=ends[2], connect=(ends[0],)), dial_all=False)
        publisher = raw.declare_publisher(RAW_KEY, congestion_control=CongestionControl.DROP)
        mesh = await Mesh.open(links(folder, "d1", ends[3], (ends[1],)), "benchmark", "d1", receive=ignore)
        plain = await Mesh.open(MeshConfig(listen=ends[5], connect=(ends[4],)), "benchmark", "d1", receive=ignore)
        await until(lambda: mesh.alive and plain.alive and publisher.matching_status.matching)
        routes: list[Callable[[bytes], None]] = [
            publisher.put,
            lambda payload: mesh.publish(drone_key("benchmark", "d1", "pose"), payload),
            lambda payload: mesh.publish(drone_key("benchmark", "d1", "cone"), payload),
            lambda payload: plain.publish(drone_key("benchmark", "d1", "pose"), payload),
            lambda payload: plain.publish(drone_key("benchmark", "d1", "cone"), payload),
        ]
        pipe.send("ready")
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        count = int(seconds * RATE_HZ)
        for _ in range(count):
            for route in routes:
                due_s += 1.0 / RATE_HZ / len(routes)
                await asyncio.sleep(max(0.0, due_s - loop.time()))
                route(time.monotonic_ns().to_bytes(8, "big") + bytes(PAYLOAD_BYTES - 8))
        pipe.send(count)
        pipe.recv()
        await mesh.close()
        await plain.close()
        raw.close()

    asyncio.run(run())


def start(work: Callable[..., None], *arguments: object) -> tuple[BaseProcess, Connection]:
    """A worker process, and the pipe to it; workers with more than one step first report that they are ready."""
    ours, theirs = SPAWN.Pipe()
    process = SPAWN.Process(target=work, args=(theirs, *arguments), daemon=True)
    process.start()
    if work is not join:
        ours.recv()
    return process, ours


def stop(peers: list[tuple[BaseProcess, Connection]]) -> None:
    for _, pipe in peers:
        pipe.send("end")
    for process, _ in peers:
        process.join(5.0)
        process.kill()


def free_ports(number: int) -> list[int]:
    probes = [socket.create_server(("127.0.0.1", 0)) for _ in range(number)]
    ports = [int(probe.getsockname()[1]) for probe in probes]
    for probe in probes:
        probe.close()
    return ports


async def until(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition():
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"the mesh is not complete within {DEADLINE_S:g} s")
        await asyncio.sleep(0.002)


def ignore(key: str, payload: bytes) -> None:
    """Discard a message."""


if __name__ == "__main__":
    main()
