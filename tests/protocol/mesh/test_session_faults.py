"""Peers in separate processes that die, hang or are cut off: the others notice, and nothing is lost."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from random import Random

import pytest

from radron.protocol.keys import drone_key
from radron.protocol.mesh import session
from radron.protocol.mesh.link import LINK_CLOSE_S
from radron.sim.live.relays.linkstate import PASSING, LinkState
from radron.sim.live.relays.tcp import Relay
from support import PATH
from support.mesh.meshes import LONG_LEASE_MS, endpoint, free_port, linked, member, peer_process, until

CONE = drone_key("s", "d1", "cone")


@asynccontextmanager
async def relay_to(port: int) -> AsyncIterator[tuple[Relay, str]]:
    """A relay to a port of this machine, and its endpoint."""
    relay = Relay(("127.0.0.1", port), Random(1))
    try:
        yield relay, endpoint(await relay.start("127.0.0.1"))
    finally:
        await relay.close()


def switch(relay: Relay, state: LinkState) -> None:
    relay.there.state = relay.back.state = state


def numbers(payloads: list[bytes]) -> list[int]:
    return [int(payload.split()[0]) for payload in payloads]


def test_a_burst_comes_complete_and_in_order() -> None:
    async def run() -> None:
        first = endpoint()
        with peer_process("d1", first, entries=session.CACHE_ENTRIES) as d1:
            async with member("d2", endpoint(), (first,)) as d2:
                await linked(d2)
                await until(lambda: d2.mesh.alive)
                assert d1.stdin is not None
                d1.stdin.write("burst\n")
                await until(lambda: len(d2.messages) >= session.CACHE_ENTRIES)
                assert numbers(d2.got(CONE)) == list(range(session.CACHE_ENTRIES))
                assert d2.bursts >= session.CACHE_ENTRIES / 100

    asyncio.run(run())


def test_a_killed_peer_is_gone_at_once_and_comes_back() -> None:
    async def run() -> None:
        first, second = endpoint(), endpoint()
        async with member("d1", first) as d1:
            with peer_process("d2", second, first, lease_ms=LONG_LEASE_MS) as d2:
                await until(lambda: d1.mesh.alive == {"d2"})
                d2.kill()
                await until(lambda: not d1.mesh.alive)  # by the end of its sockets, and not of its lease
            with peer_process("d2", second, first):
                await until(lambda: d1.mesh.alive == {"d2"})

    asyncio.run(run())


@pytest.mark.slow
def test_a_peer_that_stood_still_is_there_again_each_time() -> None:
    """By its settings Zenoh can make the link anew without the peer's declarations."""

    async def run() -> None:
        first = endpoint()
        async with member("d1", first) as d1:
            for _ in range(10):
                with peer_process("d2", endpoint(), first) as stopped:
                    await until(lambda: d1.mesh.alive == {"d2"})
                    stopped.send_signal(signal.SIGSTOP)
                    await until(lambda: not d1.mesh.alive)
                    stopped.send_signal(signal.SIGCONT)
                    await until(lambda: d1.mesh.alive == {"d2"})
                await until(lambda: not d1.mesh.alive)

    asyncio.run(run())


def test_a_peer_that_stands_still_is_gone_within_a_lease_and_its_restart_counts() -> None:
    async def run() -> None:
        first = endpoint()
        async with member("d1", first) as d1:
            with peer_process("d2", endpoint(), first) as stopped:
                await until(lambda: d1.mesh.alive == {"d2"})
                stopped.send_signal(signal.SIGSTOP)
                assert await until(lambda: not d1.mesh.alive) < 3.0  # lease 1 s, and the machine's load; Zenoh's own: 10 s
                stopped.send_signal(signal.SIGCONT)
                await until(lambda: d1.mesh.alive == {"d2"})
                stopped.send_signal(signal.SIGSTOP)
                with peer_process("d2", endpoint(), first):  # before the others have noticed
                    gone_s = time.monotonic() + 1.5
                    await until(lambda: time.monotonic() > gone_s)
                    assert d1.mesh.alive == {"d2"}

    asyncio.run(run())


@pytest.mark.slow
def test_peers_that_stand_still_stall_neither_the_healthy_ones_nor_the_close() -> None:
    async def run() -> None:
        ends = [endpoint() for _ in range(4)]
        async with member("d1", ends[0]) as d1:
            with (
                peer_process("d2", ends[1], ends[0]) as d2,
                peer_process("d3", ends[2], *ends[:2]) as d3,
                peer_process("d4", ends[3], *ends[:3], pose_bytes=200),
            ):
                await until(lambda: d1.mesh.alive == {"d2", "d3", "d4"})
                for process in (d2, d3):
                    process.send_signal(signal.SIGSTOP)
                heard, longest_s, last_s = 0, 0.0, time.monotonic()
                until_s = last_s + 2.0
                while time.monotonic() < until_s:
                    start_s = time.monotonic()
                    for _ in range(10):  # more than the sockets of the frozen peers hold
                        d1.publish("plan", bytes(60_000))
                    assert time.monotonic() - start_s < 1.0  # an agent is killed if its loop stands still for so long
                    await asyncio.sleep(0.02)
                    if len(d1.messages) > heard:
                        heard, longest_s, last_s = len(d1.messages), max(longest_s, time.monotonic() - last_s), time.monotonic()
                assert longest_s < 4.0  # poses of d4 come at 20 Hz; with Zenoh's default of two receive threads 10 s
                assert d1.mesh.alive == {"d4"}
                d3.send_signal(signal.SIGCONT)
                await until(lambda: "d3" in d1.mesh.alive)
                d3.send_signal(signal.SIGSTOP)
                for _ in range(200):
                    d1.publish("plan", bytes(60_000))
                start_s = time.monotonic()
                await d1.mesh.close()
                assert time.monotonic() - start_s < LINK_CLOSE_S  # ended by itself, not given up

    asyncio.run(run())


@pytest.mark.parametrize("cut_s", [0.4, 2.0])  # shorter and longer than a lease
def test_a_partition_loses_nothing_of_the_log(cut_s: float) -> None:
    async def run() -> None:
        port = free_port()
        async with (
            relay_to(port) as (relay, dialled),
            member("d1", endpoint(port)) as d1,
            member("d2", endpoint(), (dialled,)) as d2,
        ):
            await linked(d1, d2)
            sent = 0

            async def publish() -> None:
                nonlocal sent
                for _ in range(200):
                    for one in (d1, d2):
                        one.publish("cone", b"%d" % sent)
                        one.publish("pose", bytes(200))
                    sent += 1
                    await asyncio.sleep(0.001)

            await publish()
            switch(relay, LinkState(cut=True))
            cut_until_s = time.monotonic() + cut_s
            await publish()
            await until(lambda: time.monotonic() > cut_until_s)
            assert cut_s < 1.0 or d1.mesh.alive == d2.mesh.alive == frozenset()
            switch(relay, PASSING)
            await publish()
            for one, other in ((d1, "d2"), (d2, "d1")):
                key = drone_key("s", other, "cone")
                await until(lambda one=one, key=key: len(one.got(key)) >= sent)  # type: ignore[misc]
                assert numbers(one.got(key)) == list(range(sent))
            await linked(d1, d2)

    asyncio.run(run())


def test_what_a_partition_lost_beyond_the_cache_comes_by_the_log_query(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "CACHE_ENTRIES", 20)
    log: list[tuple[str, bytes]] = []

    async def run() -> None:
        port = free_port()
        async with (
            relay_to(port) as (relay, dialled),
            member("d1", endpoint(port), answer=lambda summary: log[int(summary) :]) as d1,
            member("d2", endpoint(), (dialled,)) as d2,
        ):
            await linked(d1, d2)
            switch(relay, LinkState(cut=True))
            await until(lambda: not d2.mesh.alive)
            assert await d2.mesh.ask("d1", b"0") == 0
            log.extend((CONE, b"%d" % i) for i in range(100))
            for key, payload in log:
                d1.mesh.publish(key, payload)
            switch(relay, PASSING)
            await linked(d1, d2)
            await until(lambda: d2.messages)
            assert await d2.mesh.ask("d1", b"0") == 100
            await until(lambda: set(d2.messages) == set(log))

    asyncio.run(run())


def test_the_process_ends_cleanly_while_peers_stand_still() -> None:
    ends = [endpoint() for _ in range(3)]
    with (
        peer_process("d1", ends[0]) as d1,
        peer_process("d2", ends[1], ends[0]) as d2,
        peer_process("d3", ends[2], *ends[:2], pose_bytes=60_000, pose_hz=1000.0) as d3,
    ):
        for process in (d1, d2):
            process.send_signal(signal.SIGSTOP)
        time.sleep(0.3)  # the sockets fill; a lease is longer
        start_s = time.monotonic()
        assert d3.stdin is not None
        d3.stdin.write("\n")
        assert d3.wait(timeout=5.0) == 0
        assert time.monotonic() - start_s < LINK_CLOSE_S  # the close, which was not given up, and the end of the interpreter


CANCELLED = """
import asyncio, sys

from radron.protocol.mesh.session import Mesh, MeshConfig

async def main():
    config = MeshConfig(connect=("tcp/203.0.113.9:7447",))
    opening = asyncio.create_task(Mesh.open(config, "s", None, receive=lambda key, payload: None))
    await asyncio.sleep(float(sys.argv[1]))
    opening.cancel()
    await asyncio.wait((opening,))

asyncio.run(main())
"""


@pytest.mark.parametrize("after_s", [0.05, 0.48])  # a session opens in 0.5 s
def test_the_process_ends_cleanly_while_the_session_is_opening(after_s: float) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CANCELLED, str(after_s)], capture_output=True, text=True, timeout=20, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


COUNT_THREADS = """
import asyncio
import contextlib
import sys
from pathlib import Path

from support.mesh.meshes import pair, until

def receive_threads():
    names = []
    for path in Path("/proc/self/task").glob("*/comm"):
        with contextlib.suppress(FileNotFoundError):  # a thread that has ended meanwhile
            names.append(path.read_text())
    return sum(name.startswith("rx-") for name in names)

async def main():
    async with pair():  # they start with the first link, and each sets its own name once it runs
        with contextlib.suppress(AssertionError):
            await until(lambda: receive_threads() == int(sys.argv[1]))
        print(receive_threads())

asyncio.run(main())
"""


@pytest.mark.parametrize(("setting", "threads"), [(None, 16), ("(rx: (worker_threads: 3))", 3)])
def test_the_receive_threads_are_raised_unless_the_user_says_otherwise(setting: str | None, threads: int) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "ZENOH_RUNTIME"}
    if setting is not None:
        environment["ZENOH_RUNTIME"] = setting
    done = subprocess.run(
        [sys.executable, "-c", COUNT_THREADS, str(threads)],
        cwd=PATH,
        env=environment,
        capture_output=True,
        text=True,
        timeout=20,
        check=True,
    )
    assert int(done.stdout) == threads


@pytest.mark.slow
def test_a_peer_that_fetches_the_log_over_a_congested_link_does_not_hold_the_publisher_up() -> None:
    async def run() -> None:
        port = free_port()
        async with member("d1", endpoint(port)) as d1, relay_to(port) as (relay, dialled):
            for _ in range(1000):
                d1.publish("cone", bytes(20_000))  # more than sockets and queues hold
            with peer_process("d2", endpoint(), dialled):
                await until(lambda: d1.mesh.alive)
                switch(relay, LinkState(cut=True))  # in the middle of the answer
                longest_s = 0.0
                while d1.mesh.alive:  # until the link is given up
                    before_s = time.monotonic()
                    d1.publish("cone", bytes(400))
                    longest_s = max(longest_s, time.monotonic() - before_s)
                    await asyncio.sleep(0.02)
                assert longest_s < 1.0  # an agent is killed if its loop stands still for so long; the put itself waits for 5 s

    asyncio.run(run())


@pytest.mark.slow
def test_of_a_peer_that_floods_its_own_messages_are_shed_and_the_others_arrive() -> None:
    """d2 sends 20,000 entries at once, and 60 kB poses as fast as it can; d1 sends as drones do, and d3 hears all of it."""

    async def run() -> None:
        first, second = endpoint(), endpoint()
        pose, cone = drone_key("s", "d1", "pose"), drone_key("s", "d1", "cone")
        async with member("d1", first) as d1, member("d3", endpoint(), (first, second), members=("d1", "d2")) as d3:
            with peer_process("d2", second, first, entries=20_000, pose_bytes=60_000, pose_hz=800.0) as d2:
                await linked(d1, d3)
                await until(lambda: d3.mesh.counters["oversized"])
                assert d2.stdin is not None
                d2.stdin.write("burst\n")
                turns: list[float] = []
                for number in range(100):
                    begun_s = time.monotonic()
                    d1.publish("pose", b"%d" % number)
                    d1.publish("cone", b"%d" % number)
                    await asyncio.sleep(0.05)
                    turns.append(time.monotonic() - begun_s - 0.05)
                await until(lambda: len(d3.got(cone)) == 100)
                assert numbers(d3.got(cone)) == list(range(100))
                assert numbers(d3.got(pose))[-1] == 99
                assert len(d3.got(pose)) > 80
                assert any("d2 floods the mesh" in problem for problem in d3.mesh.problems)
                assert not any("d1" in problem for problem in d3.mesh.problems)
                assert sorted(turns)[-5] < 0.1  # of the loop in which d3 works

    asyncio.run(run())


def test_liveliness_tokens_of_unknown_names_are_counted_and_nothing_else() -> None:
    async def run() -> None:
        first = endpoint()
        async with member("d1", first, members=("d1", "d2")) as d1, member("d2", endpoint(), (first,)) as d2:
            tokens = [d2.mesh._session.liveliness().declare_token(drone_key("s", f"x{k}", "alive")) for k in range(500)]
            await linked(d1, d2)
            d2.publish("pose", b"1")
            await until(lambda: d1.messages and d1.mesh.counters["unknown_drone"] >= 500)
            assert d1.mesh.alive == {"d2"}
            for token in tokens:
                token.undeclare()

    asyncio.run(run())
