"""Zenoh alone, as the yardstick: from a put in one process to the callback in another, with the swarm's session settings."""

from __future__ import annotations

import asyncio
import multiprocessing
import socket
import time
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from zenoh.handlers import Callback

from protocol.link import MeshConfig, open_session

KEY = "benchmark/raw"


class RawProbe:
    """Two processes, one of which puts ``payload_bytes`` every ``period_s``; use as a context, then read ``latencies_ms``."""

    def __init__(self, payload_bytes: int, period_s: float) -> None:
        self.latencies_ms: list[float] = []
        self._payload_bytes = payload_bytes
        self._period_s = period_s
        self._processes: list[BaseProcess] = []
        self._pipes: list[Connection] = []

    def __enter__(self) -> RawProbe:
        spawn = multiprocessing.get_context("spawn")
        endpoint = f"tcp/127.0.0.1:{_free_port()}"
        arguments = ((_receive, (endpoint,)), (_put, (endpoint, self._payload_bytes, self._period_s)))
        for target, values in arguments:
            ours, theirs = spawn.Pipe()
            process = spawn.Process(target=target, args=(theirs, *values), daemon=True)
            process.start()
            ours.recv()  # it is ready
            self._processes.append(process)
            self._pipes.append(ours)
        return self

    def __exit__(self, *_: object) -> None:
        receiver, sender = self._pipes
        sender.send("stop")
        self._processes[1].join(5.0)
        receiver.send("stop")
        self.latencies_ms = receiver.recv()
        for process in self._processes:
            process.join(5.0)
            process.kill()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def _receive(pipe: Connection, endpoint: str) -> None:
    latencies_ms: list[float] = []

    def take(sample: object) -> None:
        now_ns = time.time_ns()
        latencies_ms.append((now_ns - int.from_bytes(sample.payload.to_bytes()[:8], "little")) * 1e-6)  # type: ignore[attr-defined]

    session = asyncio.run(open_session(MeshConfig(listen=endpoint), dial_all=False))
    subscriber = session.declare_subscriber(KEY, Callback(take, indirect=False))
    pipe.send("ready")
    pipe.recv()
    subscriber.undeclare()
    session.close()
    pipe.send(latencies_ms[1:])  # the first one opens the way


def _put(pipe: Connection, endpoint: str, payload_bytes: int, period_s: float) -> None:
    session = asyncio.run(open_session(MeshConfig(connect=(endpoint,)), dial_all=False))
    publisher = session.declare_publisher(KEY)
    rest = bytes(max(payload_bytes - 8, 0))
    pipe.send("ready")
    while not pipe.poll(period_s):
        publisher.put(time.time_ns().to_bytes(8, "little") + rest)
    session.close()
