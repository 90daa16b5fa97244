"""The UDP relay between a vehicle and its agent."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from random import Random

from radron.sim.live.relays.linkstate import LinkState
from radron.sim.live.relays.mavlink import MavlinkRelay

LIMIT_S = 20.0


class Timer:
    """A clock that stands still, and calls that are made when the test says so."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.calls: list[tuple[float, Callable[[], None]]] = []

    def call_at(self, due_s: float, call: Callable[[], None]) -> None:
        self.calls.append((due_s, call))

    def run(self) -> None:
        for _, call in sorted(self.calls, key=lambda each: each[0]):
            call()
        self.calls.clear()


def bound() -> socket.socket:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind(("127.0.0.1", 0))
    one.setblocking(False)
    return one


def test_datagrams_pass_in_both_directions_and_late_ones_in_the_order_of_their_times() -> None:
    async def run() -> None:
        loop, timer = asyncio.get_running_loop(), Timer()
        with bound() as vehicle, bound() as agent:
            relay = MavlinkRelay(agent.getsockname(), Random(1), lambda: timer.now_s, timer.call_at)
            port = await relay.start("127.0.0.1")
            try:
                async with asyncio.timeout(LIMIT_S):
                    vehicle.sendto(b"telemetry", ("127.0.0.1", port))
                    data, rear = await loop.sock_recvfrom(agent, 100)
                    assert data == b"telemetry"
                    agent.sendto(b"setpoint", rear)
                    assert await loop.sock_recv(vehicle, 100) == b"setpoint"
                    relay.there.state = LinkState(delay_s=1.0, duplicate=1.0, within_s=0.5)
                    vehicle.sendto(b"late", ("127.0.0.1", port))
                    while len(timer.calls) < 2:
                        await asyncio.sleep(0.001)
                    assert timer.calls[0][0] == 1.0
                    assert 1.0 < timer.calls[1][0] <= 1.5
                    timer.run()
                    assert [await loop.sock_recv(agent, 100) for _ in range(2)] == [b"late", b"late"]
                    relay.there.state, relay.back.state = LinkState(cut=True), LinkState(loss=1.0)
                    vehicle.sendto(b"lost", ("127.0.0.1", port))
                    agent.sendto(b"lost", rear)
                    relay.there.state = LinkState()
                    vehicle.sendto(b"again", ("127.0.0.1", port))
                    assert await loop.sock_recv(agent, 100) in (b"lost", b"again")  # the switch may come before the first one
            finally:
                await relay.close()

    asyncio.run(run())
