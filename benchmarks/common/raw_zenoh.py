"""Latency of Zenoh alone as a reference: from a put in one process to the callback in another, with the swarm's settings."""

from __future__ import annotations

import asyncio
import multiprocessing
import socket
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from zenoh.handlers import Callback

from radron.protocol.mesh.link import MeshConfig, open_session

KEY = "benchmark/raw"


class RawProbe:
    """A process that puts ``payload_bytes`` every ``period_s``, and ``receivers`` processes that get them.

    Use it as a context, then read ``samples`` of all receivers: the wall time of the callback, s, and the latency, ms.
    """

    def __init__(self, payload_bytes: int, period_s: float, receivers: int = 1) -> None:
        self.samples: list[tuple[float, float]] = []
        self._payload_bytes = payload_bytes
        self._period_s = period_s
        self._receivers = receivers
        self._processes: list[BaseProcess] = []
        self._pipes: list[Connection] = []

    def __enter__(self) -> RawProbe:
        endpoints = tuple(f"tcp/127.0.0.1:{_free_port()}" for _ in range(self._receivers))
        for endpoint in endpoints:
            self._start(_receive, endpoint)
        self._start(_put, endpoints, self._payload_bytes, self._period_s)
        return self

    def _start(self, target: Callable[..., None], *values: object) -> None:
        spawn = multiprocessing.get_context("spawn")
        ours, theirs = spawn.Pipe()
        process = spawn.Process(target=target, args=(theirs, *values), daemon=True)
        process.start()
        ours.recv()  # the process is ready
        self._processes.append(process)
        self._pipes.append(ours)

    def __exit__(self, *_: object) -> None:
        for process, pipe in reversed(list(zip(self._processes, self._pipes, strict=True))):  # the sender first
            pipe.send("stop")
            self.samples += pipe.recv()
            process.join(5.0)
            process.kill()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def _receive(pipe: Connection, endpoint: str) -> None:
    samples: list[tuple[float, float]] = []

    def take(sample: object) -> None:
        now_ns = time.time_ns()
        sent_ns = int.from_bytes(sample.payload.to_bytes()[:8], "little")  # type: ignore[attr-defined]
        samples.append((now_ns * 1e-9, (now_ns - sent_ns) * 1e-6))

    session = asyncio.run(open_session(MeshConfig(listen=endpoint), dial_all=False))
    subscriber = session.declare_subscriber(KEY, Callback(take, indirect=False))
    pipe.send("ready")
    pipe.recv()
    subscriber.undeclare()
    session.close()
    pipe.send(samples[1:])  # the first one opens the way


def _put(pipe: Connection, endpoints: tuple[str, ...], payload_bytes: int, period_s: float) -> None:
    session = asyncio.run(open_session(MeshConfig(connect=endpoints), dial_all=False))
    publisher = session.declare_publisher(KEY)
    rest = bytes(max(payload_bytes - 8, 0))
    pipe.send("ready")
    while not pipe.poll(period_s):
        publisher.put(time.time_ns().to_bytes(8, "little") + rest)
    session.close()
    pipe.send([])
